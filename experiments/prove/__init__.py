"""The proof: every concealed case diagnosed, then the seal opened, then the answers scored with intervals.

Reading order: ``diagnosing`` (cases to answers, resumable), ``judging`` (one answer against its truth), ``measures``
(all answers), ``page`` and ``pictures`` (from saved results only), ``leak`` (does a campaign's paperwork tell?).
"""
