"""Modules that the fork server loads once for the processes of all heavy stages."""

import gc

import solver.onward
import solver.settle  # noqa: F401
import tasks.drop.stage
import tasks.measure.drift
import tasks.measure.referee
import tasks.measure.touch
import tasks.measure.views
import tasks.mesh.stage
import tasks.particles.stage
import tasks.render.stage  # noqa: F401
from tasks.cache import STAGE_FILES
from tasks.code import code_of

for module in list(STAGE_FILES):
    code_of(module)  # code as just loaded: each process compares it with the program's hashes
gc.collect()
gc.freeze()  # a garbage collection in a child would write to each object and thus copy every shared page
