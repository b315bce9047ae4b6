"""Noise coefficients from a curve: terms, their covariance, evidence, intervals and bounds."""
