# SPDX-License-Identifier: GPL-2.0-or-later
"""What the commands in tools/ are made of, by what it is about. Nothing in here imports a command."""
