"""What the unit feels on a rig, with the rig's own errors. One module a rig; none knows a sensor."""
