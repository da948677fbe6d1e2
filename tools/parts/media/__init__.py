# SPDX-License-Identifier: GPL-2.0-or-later
"""Clips, recordings, streams and logs, as an outsider reads them; counters."""
