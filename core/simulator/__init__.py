"""An oracle: writes what a tractor's recorder would have written, in the real formats, together with the truth.

``simulate.simulate(scenario, folder)`` is the whole of it; ``scenario_file.load_scenario`` reads what it works from.

The simulator judges the rest of furrowmap, so it shares no code with it: nothing here imports from the other parts of
``core`` except how errors and progress are told. Rotations, clocks and formats are written anew from their sources.

Inside the simulator the map frame is **local**: metres east and north of the ground grid's south-western corner, and
metres above the height of the place; ``t_s`` counts from the scenario's ``t0``. Yaw is in radians, counter-clockwise
from east, of the vehicle's nose. Only the files carry map coordinates, UTC and headings.
"""
