"""Numba loops and nothing else: arrays in, arrays out. Compiled on first use and cached on disk."""
