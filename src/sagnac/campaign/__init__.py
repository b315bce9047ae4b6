"""The same job many times: Monte Carlo over a grid of scenarios, or the recordings of a fleet."""
