"""The fault catalogue: every fault is injected into virtual equipment, and its outcome asserted.

catalogue    the faults, by their ids
faults       the injections, one module a group
rig          the rig that they are injected into, and what must hold after each
soak         seeded cycles of random motion, each with a fault
page         the results of a test run as `docs/results/faults.md`
"""
