"""Noise of inertial sensors from records at rest: Allan variances, spectra, the terms they are made of."""
