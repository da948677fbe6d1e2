# SPDX-License-Identifier: GPL-2.0-or-later
"""Disks of a guest: layout, slow and frozen ones, what was written to them and when."""
