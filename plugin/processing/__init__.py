# SPDX-License-Identifier: GPL-2.0-or-later
"""furrowmap's verbs as Processing algorithms, one file each on a common base."""
