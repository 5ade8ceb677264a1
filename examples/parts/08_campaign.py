"""A campaign: one mission flown many times under random conditions."""

import skywright

vary = {"world.wind.mean_mps": "uniform(0, 3)", "plant.mass_error": "normal(0, 0.02)"}
found = skywright.campaign("waypoints", 3, vary, seed=1)
print(found.verdict.answer, f"{found.verdict.succeeded} of {found.verdict.runs} succeeded")
for row in found.rows:
    print(
        row.outcome, f"{row.varied['world.wind.mean_mps']:.2f} m/s", row.metrics["position.rms_m"]
    )
