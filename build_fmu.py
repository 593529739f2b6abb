"""Build the EM-CAS FMU: parameter file in, FMU out. `python build_fmu.py --help` tells more."""

from emcas_fmu.cli import build_command

if __name__ == "__main__":
    build_command()
