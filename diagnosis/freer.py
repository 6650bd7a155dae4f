"""Which laws of one name are wider than another, and start from where it was found."""

from __future__ import annotations

_CARRIERS = ("sliding-mount", "carrier", "sliding-mount-turned", "carrier-turned")
FREER = {  # by variant, the laws of more parameters that start where it was found
    "turning-mount": _CARRIERS,
    "sliding-mount": _CARRIERS[1:],
    "carrier": _CARRIERS[2:],
    "sliding-mount-turned": (*_CARRIERS[:2], "carrier-turned"),
    "rounded": ("rounded-asymmetric", "rounded-algebraic"),
    "rounded-asymmetric": ("rounded-algebraic",),
    "dahl": ("bouc-wen-shaped", "slip-spread"),
    "bouc-wen": ("bouc-wen-shaped", "slip-spread"),
    "bouc-wen-linear": ("bouc-wen-shaped", "slip-spread"),
    "maxwell-slip": ("slip-spread",),
    **dict.fromkeys(("free-flight", "damped", "sheds"), ("cushioned", "hyperbolic", "softplus", "impact")),
    "hyperbolic": ("softplus",),
    "plain": ("presliding",),
    "presliding": ("presliding-asymmetric", "presliding-damped", "presliding-shaped"),
    "bristles": ("bristles-asymmetric", "bristles-damped", "bristles-exponential"),
    # of as many, but from a lag of the wrong order the next effect is missed
    "first-order": ("second-order", "magnitude-optimum"),
    "second-order": ("first-order", "magnitude-optimum", "damped-loop", "third-order"),
    "magnitude-optimum": ("damped-loop",),
    **dict.fromkeys(("cubic", "piecewise"), ("piecewise-cubic", "power")),
    "elbow": ("cantilever",),
    "mount": ("mount-limited",),
    "input-side-rounded": ("input-side-quadrants",),
    "output-side-rounded": ("output-side-quadrants",),
    "motor-order": (
        "motor-order-harmonic",
        "output-order-harmonic",
        "motor-order-reacting",
        "motor-order-reacting-harmonic",
    ),
    "output-order": ("output-order-harmonic", "output-order-reacting", "output-order-reacting-harmonic"),
    "cogging": ("cogging-harmonic",),
}
