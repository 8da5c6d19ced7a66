"""The one visual language of all views: what is shown, at which entity path, in which colour, under which name and unit.

Depth runs from dark blue (deep) to pale (shallow) as in every other product. Orange is what we computed, grey what
navigation alone says, green the laser itself; the axes x, y, z are red, green, blue as everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

APPLICATION = "garbi"
TIMELINE = "stamp"

Colour = tuple[int, int, int]

OURS: Colour = (255, 140, 40)
NAVIGATION: Colour = (150, 158, 170)
LASER: Colour = (60, 240, 110)
CAMERA: Colour = (90, 170, 250)
HULL: Colour = (240, 190, 60)
FRAME: Colour = (92, 100, 112)
THRUSTER: Colour = (52, 58, 68)
AXES: tuple[Colour, Colour, Colour] = ((235, 90, 90), (110, 200, 90), (90, 150, 250))
BACKGROUND: Colour = (14, 20, 28)
ALARM: Colour = (236, 84, 76)
CAUTION: Colour = (244, 190, 70)
WELL: Colour = (92, 190, 120)
QUIET: Colour = (84, 100, 122)
TRUTH: Colour = (214, 120, 220)


@dataclass(frozen=True)
class Thing:
    """Something that views draw: entity path, colour, what it is called and what it means to a newcomer."""

    path: str
    colour: Colour
    name: str
    meaning: str


@dataclass(frozen=True)
class Plot:
    """Curves that share an axis: entity path, title with the unit, name and colour of each curve."""

    path: str
    title: str
    curves: tuple[tuple[str, Colour], ...]


@dataclass(frozen=True)
class Colouring:
    """A way of colouring the growing map: its name, the component that holds the colours, and what they mean."""

    name: str
    component: str
    meaning: str


WORLD = "map"
VEHICLE = "map/vehicle"
BODY = "map/vehicle/body"
RIG = "map/vehicle/rig"
CAMERA_POSE = "map/vehicle/rig/camera"
IMAGE = "map/vehicle/rig/camera/image"
ABOUT = "about"
LOSSES = "losses"
ROUNDS = "curves/rounds"

ROUTE = Thing("map/route/registered", OURS, "orange line", "the vehicle's path, corrected by what the laser saw twice")
ROUTE_NAVIGATION = Thing("map/route/navigation", NAVIGATION, "grey line", "the path from the navigation sensors alone")
POSE_SIGMA = Thing("map/route/uncertainty", OURS, "orange ellipsoids", "how sure the path is within the map, 1 sigma")
PROFILE = Thing("map/vehicle/rig/profile", LASER, "green points", "the profile that the camera sees at this moment")
SHEET = Thing("map/vehicle/rig/sheet", LASER, "green fan", "the laser's sheet of light")
STRIPE = Thing(IMAGE + "/stripe", OURS, "orange dots in the image", "the laser line as it was found")
CANDIDATES = Thing(IMAGE + "/candidates", CAMERA, "blue dots", "what else might have been the laser line")
STRIPE_SIGMA = Thing(IMAGE + "/sigma", CAUTION, "yellow bars", "how sure the laser line is, 1 sigma, 20 x larger")
MESH = Thing("map/seabed/mesh", (30, 116, 148), "surface", "the finished seabed as a mesh, dark blue is deep")
POINTS = Thing("map/seabed/points", (30, 116, 148), "points", "the map as it grows")

LOOPS = Thing("map/route/loops", WELL, "green lines", "two passes over the same ground that were found to be the same")
TRUTH_ROUTE = Thing("map/truth/route", TRUTH, "violet line", "the true path, where the log of a simulation has it")
TRUTH_SURFACE = Thing(
    "map/truth/seabed", (30, 116, 148), "true surface", "the seabed as it is, where the log of a simulation has it"
)
REJECTED = Thing("map/seabed/moving", ALARM, "red points", "what moved or floated: seen, and left out of the map")

BEFORE = Thing("map/before", (30, 116, 148), "surface, before", "the earlier of two maps that are compared")
AFTER = Thing("map/after", (30, 116, 148), "surface, after", "the later one, laid on it")
RISEN = Thing("map/changes/risen", (232, 84, 64), "red patches", "what rose or was added between two maps")
FALLEN = Thing("map/changes/fallen", (60, 120, 240), "blue patches", "what sank or is gone")
MOVE = Thing("map/changes/moved", CAUTION, "yellow arrow", "a thing that moved, from where to where")

COMMAND = Thing("map/vehicle/intent/command", OURS, "orange arrow", "the command, after safety had the last word")
PROPOSAL = Thing("map/vehicle/intent/proposal", CAMERA, "other arrows", "what each behaviour wants")
SAFE = Thing("map/vehicle/intent/safe_set", WELL, "green outlines", "the safe set: where arrows may end")
OCCUPIED = Thing("map/volume/occupied", (92, 128, 156), "blue-grey blocks", "where something is")
FREE = Thing(
    "map/volume/free", (58, 70, 88), "grey dots", "water at the vehicle's depth seen to be free, the rest unknown"
)
MOVING = Thing("map/moving/things", ALARM, "red ball", "something that moves, its arrow says where to")
MOVING_VELOCITY = "map/moving/velocity"
WORDS = "words"
LANES = "lanes"

ACTS, LEADS, CHANGES, TROUBLE = "acts", "leads", "changes it", "trouble"
MET, MISSED = "met", "missed"
NOTHING, DAMAGED, WHOLE = "nothing", "damaged", "without gaps"
STATES: dict[str, Colour] = {
    ACTS: CAMERA,
    LEADS: OURS,
    CHANGES: CAUTION,
    TROUBLE: ALARM,
    MET: WELL,
    MISSED: ALARM,
    "held": WELL,
    "failed": ALARM,
    "no encounter": QUIET,
    NOTHING: CAUTION,
    DAMAGED: ALARM,
    WHOLE: WELL,
}
"""What bands on the timeline say, and in which colour."""
_BEHAVIOURS: dict[str, Colour] = {
    "avoidance": ALARM,
    "travel": CAMERA,
    "hold": (178, 140, 250),
    "survey": (80, 210, 210),
}


def proposal(name: str) -> Thing:
    """The arrow of a behaviour."""
    return Thing(f"{PROPOSAL.path}/{name}", _BEHAVIOURS.get(name, NAVIGATION), f"arrow of {name}", "what it wants")


SIGMA_SCALE = 20.0
"""How many times larger than 1 sigma STRIPE_SIGMA is drawn."""

COLOURINGS = (
    Colouring("Depth", "Points3D:colors", "dark blue is deep, pale is shallow"),
    Colouring("Intensity", "Colouring:intensity", "how brightly the laser came back"),
    Colouring("Uncertainty", "Colouring:uncertainty", "dark is sure, yellow is weak"),
    Colouring("Sweep", "Colouring:sweep", "each pass of the laser in its own colour"),
    Colouring("Age", "Colouring:age", "dark is the begin of the dive, yellow its end"),
    Colouring("Residual", "Colouring:residual", "blue lies below the finished surface, red above it"),
)

DRIFT_POSITION = Plot("curves/drift/position", "Drift found, mm", tuple(zip("xyz", AXES, strict=True)))
DRIFT_TILT = Plot(
    "curves/drift/tilt", "Drift found, roll and pitch, degrees", tuple(zip(("roll", "pitch"), AXES[:2], strict=True))
)
DRIFT_YAW = Plot("curves/drift/yaw", "Drift found, yaw, degrees", (("yaw", AXES[2]),))
MISFIT = Plot("curves/misfit", "Sweep to finished map, mm", (("this map", OURS), ("navigation alone", NAVIGATION)))
ENCODER = Plot("curves/encoder", "Laser angle, degrees", (("laser angle", LASER),))
DEPTH = Plot("curves/depth", "Depth, m", (("depth", AXES[2]),))
SPEED = Plot("curves/speed", "Speed, m/s", (("speed", OURS),))
ATTITUDE = Plot("curves/attitude", "Attitude, degrees", tuple(zip(("roll", "pitch", "yaw"), AXES, strict=True)))
VELOCITY = Plot("curves/velocity", "Velocity over ground, m/s", tuple(zip("xyz", AXES, strict=True)))
STRENGTH = Plot("curves/stripe", "Stripe: strength of 255, rows seen in %", (("strength", LASER), ("rows seen", OURS)))
BACKSCATTER = Plot(
    "curves/water",
    "Water: backscatter beside the stripe, of 255",
    (("left of it", CAUTION), ("right of it", NAVIGATION)),
)
SURGE = Plot("curves/surge", "Surge, m/s", (("asked for", NAVIGATION), ("commanded", OURS)))


def activation(name: str) -> Plot:
    """How much a behaviour wants to act."""
    return Plot(f"curves/activation/{name}", "Activation, 0 to 1", ((name, proposal(name).colour),))


ACTIVATION = "curves/activation"
