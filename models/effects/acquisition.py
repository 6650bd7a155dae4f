r"""What the instruments do: nothing of it is in the machine, so all of it is description.

delay > 0: the device that is not the DAQ stamps late; ppm > 0: its clock runs fast; gain: true over stated.
"""

from __future__ import annotations

from jointscope.errors import RefusedError
from jointscope.models.effects.building import Building, Parameters


def delay(building: Building, location: str, variant: str, p: Parameters) -> str:
    """One device's stamps are late, or it reads the arm's encoder late."""
    building.law("encoder-delay" if variant == "encoder" else "delay", delay=p["delay"])
    return ""


def clock_drift(building: Building, location: str, variant: str, p: Parameters) -> str:
    """One device's clock runs fast."""
    building.law("clock-drift", ppm=p["ppm"])
    return ""


def _place(variant: str) -> dict[str, float]:
    """The radius [m] of the only accelerometer that a law is of, ``mount-at-0.92``; nothing where it is of all."""
    _, at, radius = variant.partition("-at-")
    try:
        return {"radius": float(radius)} if at else {}
    except ValueError:
        raise RefusedError(
            f"model.json: variant {variant!r} names no radius [m] after '-at-'; diagnose the campaign again"
        ) from None


def tilt(building: Building, location: str, variant: str, p: Parameters) -> str:
    """The accelerometer's axis is off tangential."""
    building.law("sensor-tilt", angle=p["angle"], **_place(variant))
    return ""


def resonance(building: Building, location: str, variant: str, p: Parameters) -> str:
    """The accelerometer's mount resonates, or its bandwidth ends, or both."""
    if variant.startswith("bandwidth") or "damping" not in p:
        building.law("sensor-bandwidth", frequency=p["frequency"], **_place(variant))
    else:
        building.law("sensor-resonance", frequency=p["frequency"], damping=p["damping"], **_place(variant))
        if "corner" in p:
            building.law("sensor-bandwidth", frequency=p["corner"] * p["frequency"], **_place(variant))
    return ""


def saturation(building: Building, location: str, variant: str, p: Parameters) -> str:
    """The accelerometer clips, or is compressed towards a level."""
    knee = {"knee": p["knee"]} if "knee" in p else {}
    building.law("sensor-saturation", level=p["level"], **knee, **_place(variant))
    return ""


def sensitivity(building: Building, location: str, variant: str, p: Parameters) -> str:
    """Accelerometer or force cell off."""
    if variant == "force":
        building.law("force-gain", gain=p["gain"])
    else:
        building.law("accelerometer-gain", gain=p["gain"], **_place(variant))
    return ""


def torque_log(building: Building, location: str, variant: str, p: Parameters) -> str:
    """The log is held, averaged or thinned out at its own rate, or has a line that was folded down."""
    more = {key: p[key] for key in ("age", "line") if key in p}
    building.law("torque-log", rate=p["rate"], form=variant, **more)
    return ""


def vibration(building: Building, location: str, variant: str, p: Parameters) -> str:
    """A disturbance from outside; its phase in a run is another in each, so it must be given to replay."""
    building.law(
        "external-vibration", frequency=p["frequency"], amplitude=p["amplitude"], mount=variant == "mount"
    )
    return ""
