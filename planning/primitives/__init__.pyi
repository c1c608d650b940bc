from .pinch import NoPinch as NoPinch, PinchPlan as PinchPlan, PinchPlanner as PinchPlanner
