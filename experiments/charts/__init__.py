"""One description of a figure, three outputs: the inline drawing of a page, a PNG, and a CSV of the plotted numbers.

``chart`` holds the description, ``svg`` and ``png`` draw it, ``files`` leaves it on disk, ``looks`` says how lines and
marks are told apart (by dash and shape as much as by colour), ``ticks`` where an axis is labelled.
"""
