"""Write the tables of this folder: inspections drawn from known curves (seed 5).

    python examples/pod/make_inspections.py

hit_miss.csv: 72 cracks passed over twice each and 240 sites without a crack; two operators, of whom
the first finds smaller cracks; contact is lost at 3 % of the cracks. a_hat.csv: 60 cracks, the
logarithm of the signal a line over that of the depth.
"""

import csv
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent


def write(name: str, header: str, rows: list[tuple[object, ...]]) -> None:
    with (HERE / name).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header.split(","))
        writer.writerows(rows)


def main() -> None:
    r = np.random.default_rng(5)
    rows: list[tuple[object, ...]] = []
    depths = np.exp(r.uniform(np.log(0.1), np.log(2.0), 72))
    for k, depth in enumerate(depths, 1):
        operator = "A" if k % 2 else "B"
        middle = 0.35 if operator == "A" else 0.55
        touched = r.random() > 0.03
        for _ in range(2):  # two passes over a crack are alike: what hides it hides it twice
            shift = np.log(depth / middle) / 0.45 + (0.5 * r.normal() if touched else -9.0)
            hit = int(r.random() < 1.0 / (1.0 + np.exp(-1.8 * shift)))
            rows.append((f"c{k:02d}", f"{depth:.3f}", hit, int(touched), operator))
    for k in range(1, 241):
        rows.append((f"s{k:03d}", "0", int(r.random() < 0.008), 1, "AB"[k % 2]))
    write("hit_miss.csv", "flaw,depth_mm,hit,contact,operator", rows)

    depths = np.exp(r.uniform(np.log(0.15), np.log(3.0), 60))
    signals = 80.0 * depths**0.8 * np.exp(0.22 * r.normal(size=60))
    pairs = zip(depths, np.clip(signals, 5.0, 150.0), strict=True)
    rows = [(f"{d:.3f}", f"{s:.1f}") for d, s in pairs]
    write("a_hat.csv", "depth_mm,ahat", rows)


if __name__ == "__main__":
    main()
