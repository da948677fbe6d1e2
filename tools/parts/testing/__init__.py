# SPDX-License-Identifier: GPL-2.0-or-later
"""How the suite runs, and what it needs beside guests: crash loops, power cuts of settings."""
