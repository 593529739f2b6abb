"""Build an FMU, as `emcas build` does. `python build_fmu.py --help` prints the options."""

from emcas_fmu.cli import build_command

if __name__ == "__main__":
    build_command()
