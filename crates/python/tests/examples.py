"""Runs the examples of all docstrings, and looks that every public name has one."""

import doctest
import inspect
import sys

import teleopd
from teleopd import plotting

failed = doctest.testmod(teleopd).failed + doctest.testmod(plotting).failed
for name in teleopd.__all__:
    if name in ("MODES", "Session", "Trajectory", "Recording"):
        continue
    one = getattr(teleopd, name)
    places = [one, *(value for key, value in vars(one).items() if inspect.isfunction(value) and key[0] != "_")] if inspect.isclass(one) else [one]
    for place in places:
        if ">>>" not in (inspect.getdoc(place) or ""):
            print(f"{name}: {place} has no example")
            failed += 1
sys.exit(failed > 0)
