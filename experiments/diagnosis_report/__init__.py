"""The page that a diagnosis leaves behind: what is wrong, where, how sure, what to do next, and the evidence for it.

``report.write_report`` is the entry; ``traces`` gathers what was recorded and predicted, ``drawing`` and ``bars`` are
the first screen, ``figures`` the evidence, ``wording`` the sentences.
"""
