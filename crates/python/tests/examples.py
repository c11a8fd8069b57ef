"""Runs the examples of all docstrings, and looks that every public name has one."""

import doctest
import inspect
import sys

import teleopd
from teleopd import datasets, lerobot, mjcf, plotting, ray

modules = (teleopd, plotting, datasets, lerobot, mjcf, ray)
failed = sum(doctest.testmod(module, optionflags=doctest.ELLIPSIS).failed for module in modules)
public = [(name, getattr(teleopd, name)) for name in teleopd.__all__ if name not in ("MODES", "Session", "Trajectory", "Recording")]
for module in modules[2:]:
    public += [(name, one) for name, one in vars(module).items() if inspect.isfunction(one) and one.__module__ == module.__name__ and name[0] != "_"]
for name, one in public:
    if name == "main":
        continue
    places = [one, *(value for key, value in vars(one).items() if inspect.isfunction(value) and key[0] != "_")] if inspect.isclass(one) else [one]
    for place in places:
        if ">>>" not in (inspect.getdoc(place) or ""):
            print(f"{name}: {place} has no example")
            failed += 1
sys.exit(failed > 0)
