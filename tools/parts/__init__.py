# SPDX-License-Identifier: GPL-2.0-or-later
"""Parts of the commands in tools/, by subject. No part imports a command."""
