# SPDX-License-Identifier: GPL-2.0-or-later
"""What only the tests use, in several of their files or folders."""
