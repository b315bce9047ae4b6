"""Deviations and spectra of samples, their degrees of freedom, and what was lost of them."""
