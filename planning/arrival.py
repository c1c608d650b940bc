"""When an axis has arrived at the end of a motion: the same tolerances on the robot and in the
simulation.
"""

#: Largest distance from the last point, rad.
ARRIVED_POSITION_RAD = 5e-4
#: Largest speed, rad/s.
ARRIVED_SPEED_RAD_S = 5e-3
#: Time after the motion's end within which every axis has to arrive, s.
ARRIVAL_TIME_S = 1.0
