# SPDX-License-Identifier: GPL-2.0-or-later
"""Running measurements side by side, and drawing them."""
