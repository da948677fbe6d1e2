# SPDX-License-Identifier: GPL-2.0-or-later
"""What the development image is made of: Debian's kernel and sources, our programs, the root file system."""
