"""Logs of ArduPilot (DataFlash): samples, the autopilot's own correction taken back."""
