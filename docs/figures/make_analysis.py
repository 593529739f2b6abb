"""Draw the pictures of docs/tools/analysis.md: `python docs/figures/make_analysis.py`."""

from __future__ import annotations

from make_tables import save

from emcas_fmu.parameters import load_parameters
from emcas_fmu.plotting import plots
from emcas_fmu.studies.analysis import pictures
from emcas_fmu.studies.analysis.analyse import analyse

PLOTS = {"nichols": pictures.nichols, "amplitudes": pictures.amplitudes, "capability": pictures.fin_capability}


def main() -> None:
    analysis = analyse(load_parameters())
    for name, draw in PLOTS.items():
        with plots.style():
            save(draw(analysis).figure, f"analysis_{name}")


if __name__ == "__main__":
    main()
