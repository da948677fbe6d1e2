# SPDX-License-Identifier: GPL-2.0-or-later
"""A lossy link between a robot and its operators, in network namespaces."""
