"""The one visual language of all views: what is shown, at which entity path, in which colour, name and unit.

Depth runs from dark blue (deep) to pale (shallow) as in every other product; orange is ours (registered), grey is what
navigation alone says, green is the laser, red is what is wrong or weak.
"""

from __future__ import annotations

from dataclasses import dataclass

TIMELINE = "stamp"
APPLICATION = "garbi"

Colour = tuple[int, int, int]

OURS: Colour = (255, 140, 40)
NAVIGATION: Colour = (150, 155, 165)
LASER: Colour = (60, 240, 110)
WRONG: Colour = (235, 70, 70)
HULL: Colour = (240, 190, 60)
DARK: Colour = (62, 68, 78)
CAMERA: Colour = (90, 170, 250)
X_AXIS: Colour = (235, 90, 90)
Y_AXIS: Colour = (110, 200, 90)
Z_AXIS: Colour = (90, 150, 250)


@dataclass(frozen=True)
class Thing:
    """One thing that views show: its entity path, what it is called there, what it means to a newcomer."""

    path: str
    name: str
    colour: Colour
    meaning: str


WORLD = "map"
VEHICLE = "map/vehicle"
RIG = "map/vehicle/rig"
CAMERA_PATH = "map/vehicle/rig/camera"
IMAGE = "map/vehicle/rig/camera/image"

ROUTE = Thing("map/path/registered", "path", OURS, "where the vehicle went, drift corrected")
ROUTE_NAVIGATION = Thing(
    "map/path/navigation", "path, navigation alone", NAVIGATION, "the same without the laser's help"
)
POSE_SIGMA = Thing("map/path/uncertainty", "uncertainty of position", OURS, "1 sigma, drawn 20 times larger")
PROFILE = Thing("map/vehicle/rig/profile", "profile", LASER, "the points that the laser shows at this moment")
STRIPE = Thing(IMAGE + "/stripe", "stripe", LASER, "the laser line as it was found in the image")
SHEET = Thing("map/vehicle/rig/sheet", "sheet", LASER, "the laser's plane at this moment")
MESH = Thing("map/seabed/mesh", "seabed", (255, 255, 255), "the finished surface")

CLOUD = "map/seabed/cloud"
BY_DEPTH = Thing(CLOUD + "/by_depth", "Depth", (30, 116, 148), "dark blue is deep, pale is shallow")
BY_INTENSITY = Thing(CLOUD + "/by_intensity", "Intensity", (220, 220, 220), "how brightly the laser came back")
BY_UNCERTAINTY = Thing(CLOUD + "/by_uncertainty", "Uncertainty", WRONG, "dark is sure, red and yellow is weak")
BY_SWEEP = Thing(CLOUD + "/by_sweep", "Sweep", (180, 120, 220), "each sweep of the laser in its own colour")
COLOURINGS = (BY_DEPTH, BY_INTENSITY, BY_UNCERTAINTY, BY_SWEEP)

DRIFT_POSITION = "curves/drift/position"
DRIFT_ATTITUDE = "curves/drift/attitude"
MISFIT = "curves/misfit"
ENCODER = "curves/laser"
DEPTH = "curves/depth"
ATTITUDE = "curves/attitude"
VELOCITY = "curves/velocity"
STRIPE_ROWS = "curves/stripe"
SPEED = "curves/speed"
ROUNDS = "rounds"
LOSSES = "losses"
ABOUT = "about"

SIGMA_SCALE = 20.0
"""How many times larger than 1 sigma the ellipsoids are drawn."""
