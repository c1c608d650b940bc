from .collision import CollisionModel as CollisionModel
from .kinematics import InverseSolution as InverseSolution, Kinematics as Kinematics
