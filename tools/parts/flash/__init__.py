# SPDX-License-Identifier: GPL-2.0-or-later
"""Writing an image to a real disk, and comparing."""
