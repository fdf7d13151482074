# SPDX-License-Identifier: GPL-2.0-or-later
"""furrowmap's commands as Processing algorithms, built from one description of each."""
