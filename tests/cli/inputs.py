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
