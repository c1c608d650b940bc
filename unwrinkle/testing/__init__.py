"""Builders that tests and benchmarks share: scenes, targets, plans and observations.

table               the shipped cell's working table, for scenes without a robot
towels              range maps of synthetic towels, and what was found beside the truth
traced_pair         the stereo pair of a towel, without a renderer
calibration_scene   a head that is not the nominal one, and boards in front of it
cells               the shipped cell, its planner and a plan, each made once
targets             flattening targets, and the planning benchmark's set of them
plans               short plans and verdicts, made without a search
observations        observations with chosen features
scripted_station    the whole loop around devices that follow a script
drake_ik            inverse kinematics by optimisation, to compare with
toppra_bound        least durations without a jerk limit, to compare with
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
