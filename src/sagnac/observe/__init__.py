"""Samples to few numbers with covariance: means of segments, static intervals."""
