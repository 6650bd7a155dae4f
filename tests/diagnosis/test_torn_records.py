"""Records with samples missing: scored where they are whole, and looked at as a whole without leaps."""

from dataclasses import replace

import numpy as np

from jointscope.diagnosis.prepare import prepare


def test_missing_samples_of_a_turned_encoder_are_no_leaps(builders, edited, plant):
    """What is missing is never scored, and nothing that looks at the record as a whole sees the arm leap to zero."""
    rng = np.random.default_rng(4)

    def gappy(channel):
        if channel.quantity != "angle":
            return channel
        samples = np.asarray(channel.samples).copy()
        samples[rng.choice(samples.size - 400, 30, replace=False) + 200] = np.nan
        return replace(channel, samples=samples)

    whole = builders.sweep_run(plant, 30.0, "s")
    sound = prepare(builders.campaign_of([whole])).runs[0]
    torn = prepare(builders.campaign_of([edited(whole, gappy)])).runs[0]
    at = next(k for k, o in enumerate(sound.outputs) if o.quantity == "angle")
    a, b = sound.outputs[at], torn.outputs[at]
    assert b.mask.sum() < a.mask.sum()
    assert np.allclose(b.data[b.mask], a.data[b.mask], atol=1e-9)
    assert np.max(np.abs(b.data - a.data)) < np.max(np.abs(np.diff(a.data)))
