# SPDX-License-Identifier: GPL-2.0-or-later
"""Modules that only the tests use, in several of their files or folders."""
