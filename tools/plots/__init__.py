# SPDX-License-Identifier: MIT
"""The pictures of tools/plot.py, one module a kind."""
