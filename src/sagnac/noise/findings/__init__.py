"""What disturbs a noise test: lost samples, faulty channels, steps, drifts and lines."""
