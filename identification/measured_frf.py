"""FRFs that another analyser measured (``quantity = "frf"``, UFF 58), brought to the form the fit takes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jointscope.identification.errors_in_variables import HitSpectrum
from jointscope.identification.hit_spectra import Hit
from jointscope.identification.hits import Contact
from jointscope.recordings.campaign import Nameplate, Run

_DERIVATIVES = {"accelerance": 0, "mobility": -1, "receptance": -2}

_NO_CONTACT = Contact(
    window=np.zeros(0, dtype=np.intp), length=0.0, peak=1.0, at=0, noise=0.0, offset=0.0, secondary=0.0,
    secondary_delay=0.0, pulses=1,
)  # fmt: skip


def frf_hits(runs: Sequence[Run], rig: Nameplate) -> list[Hit]:
    """Every stream of FRFs as one hit of unit force, its columns as outputs.

    A channel's ``radius`` is taken for both the hit point and the sensor (driving point) on a rotational rig: the
    response of q'' to torque is the accelerance over radius squared.
    """
    found = []
    for run in runs:
        for stream in run.streams:
            columns = [c for c in stream.channels if c.quantity == "frf" and c.samples is not None]
            if not columns or stream.frequency is None:
                continue
            axis = stream.frequency
            keep = axis > 0.0
            s = 2j * np.pi * axis[keep]
            turning = rig.motion == "rotational"
            lever = [(c.radius or 1.0) ** 2 if turning else 1.0 for c in columns]
            sensor = [r * s ** _DERIVATIVES[c.form or "accelerance"] for r, c in zip(lever, columns, strict=True)]
            step = float(np.median(np.diff(axis))) if axis.size > 1 else 1.0
            unit = ("N m" if turning else "N") if all(c.calibrated for c in columns) else "input unit"
            found.append(
                Hit(
                    spectrum=HitSpectrum(
                        run=run.id,
                        frequency=np.asarray(axis[keep], dtype=float),
                        output=np.array([np.asarray(c.samples)[keep] for c in columns], dtype=complex),
                        input=np.ones(int(keep.sum()), dtype=complex),
                        input_basis=np.zeros((int(keep.sum()), 0), dtype=complex),
                        sensor=np.array(sensor, dtype=complex),
                        duration=1.0 / step,
                        level=1.0,
                        impulse=1.0,
                        input_noise=0.0,
                    ),
                    contact=_NO_CONTACT,
                    outputs=tuple(c.column for c in columns),
                    input_unit=unit,
                    calibrated=all(c.calibrated for c in columns),
                    repeat_of=run.repeat_of,
                )
            )
    return found
