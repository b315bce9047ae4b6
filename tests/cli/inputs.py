"""Files that commands read, as texts."""

WANTED = """
latitude = "45 deg"
gravity = "9.8061992 m/s^2"
[unit]
noise = { accel = "10 ug/sqrt(Hz)" }
[rig]
angle_uncertainty = "1 arcmin"
[optimise]
method = "norm"
sensors = ["accel"]
positions = 12
dwell = "60 s"
candidates = { directions = 150 }
"""

CAMPAIGN = """
scenario = "norm"
runs = 4

[set]
"plan.dwell" = "1 s"
"plan.turning" = "0 s"
"plan.move" = "0.5 s"
"recording.frequency" = "16 Hz"
"recording.sensors" = "accel"
"""
