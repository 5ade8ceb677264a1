"""Measurement of claims of the source papers: `skywright reproduce`.

A claim is data (`claims/PAPER.toml`): the statement, the printed values, and the flights and
measures that test it. Verdicts follow from measured values; only their explanations are text.
"""
