# SPDX-License-Identifier: GPL-2.0-or-later
"""A machine that runs an image, in QEMU or in namespaces of this one, and whatever talks to it."""
