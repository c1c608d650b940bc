"""A verified two-arm plan for a capture, and what the verification measured.

Run: python examples/plan_and_verify.py
"""

import unwrinkle as uw

flattener = uw.Flattener(uw.load_cell())
seen = flattener.observe(uw.load_capture(uw.model_file("captures/towel.npz")))
proposal = flattener.propose(seen)
if proposal.plan is None:
    raise SystemExit(proposal.reason)

proposal.plan.save("plan.npz")
print(proposal.verdict.summary())
for name, outcome, worst, limit, _, where in proposal.verdict.rows():
    print(f"{name:18s} {outcome:5s} {worst:>14s} {limit:>14s}  {where}")
