"""Alignment: a navigation system learns its attitude, at rest or from another system that moves with it."""
