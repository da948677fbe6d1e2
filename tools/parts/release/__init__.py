# SPDX-License-Identifier: GPL-2.0-or-later
"""What is in an image, and how large it may be."""
