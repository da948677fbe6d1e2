# SPDX-License-Identifier: GPL-2.0-or-later
"""Parts of the development image: Debian's kernel and sources, our programs, the root file system."""
