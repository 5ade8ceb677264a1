"""Claims of the source papers, measured: `skywright reproduce`.

A claim is data (`claims/PAPER.toml`): what the paper says, what it prints, which flights measure it
and how. Verdicts follow from measured values; only their explanations are text.
"""
