# SPDX-License-Identifier: GPL-2.0-or-later
"""The benchmarks: a module for each one (`make bench` runs them by tools/bench), what they share, and peers in C."""
