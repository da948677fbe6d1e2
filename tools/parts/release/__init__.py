# SPDX-License-Identifier: GPL-2.0-or-later
"""The contents of an image, and limits of their size."""
