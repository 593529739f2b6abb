"""Tables of pages in docs, from declarations and from simulations.

    python docs/figures/make_tables.py           # writes the tables between their markers
    python docs/figures/make_tables.py --check   # exit code 1 if a table is stale
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import degrees, pi, radians, sin
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from emcas_fmu.actuators import EXTENSIONS, NAMES, NONLINEAR, capabilities, get, get_extension
from emcas_fmu.actuators.supply_line import BUS
from emcas_fmu.bench.excitation import Excitation, reference_case
from emcas_fmu.bench.linear.actuator import LOOPS as LINEAR_LOOPS
from emcas_fmu.bench.measure import TESTS
from emcas_fmu.bench.metrics import FIGURES
from emcas_fmu.bench.requirements import load_requirements
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.extensions import fault_list, monitors
from emcas_fmu.fmi.interface import MIXING, FmuInterface
from emcas_fmu.pages.numbers import with_unit
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference.cases import CASES
from emcas_fmu.runtime import codegen
from emcas_fmu.simulation import simulate, simulate_fins
from emcas_fmu.studies.analysis import capability, envelope
from emcas_fmu.studies.analysis.analyse import SECTIONS
from emcas_fmu.studies.baseline import comparison_output as output
from emcas_fmu.studies.baseline.comparison import compare, first, record
from emcas_fmu.studies.compare import sets
from emcas_fmu.studies.fitting import fit
from emcas_fmu.studies.identification.drive import response
from emcas_fmu.variables import Variable

DOCS = Path(__file__).resolve().parents[1]
if str(DOCS.parent) not in sys.path:
    sys.path.append(str(DOCS.parent))

from tests.simulation import ramped_core  # noqa: E402

FINE = 1e-4  # s, the communication step with which STEPS are compared
STEPS = (5e-4, 1e-3, 2e-3, 5e-3, 1e-2)  # s, communication steps
STOP = 1.0  # s, end of the runs of steps()
ROUNDING = 1e-9  # deg, a thousand times the differences due to rounding
SHOWN = 6  # rows of the drift table
# Other kinds of actuation (make_comparison.py); the remaining actuators are models of the default one.
KINDS = ("worm-gear", "worm-gear-elastic", "clutch", "series-clutch", "servo", "electrohydrostatic", "electrohydraulic")
MODELS = tuple(name for name in NAMES if name not in KINDS)


def markdown(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a Markdown table."""
    header = list(header)
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def save(figure: Figure, name: str, dpi: int = 110) -> None:
    """Write a figure as docs/figures/NAME.png, without Matplotlib's version, which would change the bytes."""
    figure.savefig(DOCS / "figures" / f"{name}.png", dpi=dpi, facecolor="white", metadata={"Software": None})


def _start(v: Variable) -> str:
    if v.causality == "output":
        return ""
    start = load_parameters().values[v.key] if v.key else v.start
    return str(start).lower() if isinstance(start, bool) else f"{start:g}"


def _wiring(variables: Iterable[Variable], name: Callable[[Variable], str] = lambda v: v.name) -> str:
    return markdown(("name", "", "unit", "start", "meaning and sign"),
                     ((f"`{name(v)}`", {"input": "in", "output": "out", "parameter": "parameter"}[v.causality],
                       "Boolean" if v.kind == "Boolean" else v.unit, _start(v) if v.causality == "input" else "",
                       v.description) for v in variables))


def single() -> str:
    """Return the table of inputs and outputs of one actuator."""
    return _wiring((*get(NONLINEAR).inputs, *get(NONLINEAR).outputs))


def several() -> str:
    """Return the table of the variables of an FMU with four fins that belong to no fin, and lists of the others."""
    fmu = FmuInterface(4)
    of_fin = [v for v in (*fmu.actuator.inputs, *fmu.actuator.outputs) if v.name not in fmu.shared]
    names = ", ".join(f"`fin[1].{v.name}`" for v in of_fin)
    return (_wiring((*MIXING, *fmu.line_outputs, *BUS.parameters))
            + "\n\nShared by all fins, at the top: " + ", ".join(f"`{name}`" for name in fmu.shared)
            + f".\n\nOf each fin: {names}, and every parameter, such as `fin[1].mounting.azimuth`.")


@dataclass(frozen=True)
class Loop:
    """A host's loop: `command` [rad] over time [s], held or `ramped`, and `torque` [N.m] over the last angle [rad]."""

    title: str
    command: Callable[[float], float]
    torque: Callable[[float], float]
    ramped: bool = False

    def angles(self, step: float) -> list[float]:
        """Return the fin angle [deg] at every communication step of `step` [s], from 0 to STOP."""
        values = dict(load_parameters().values)
        values["encoder.enabled"] = False  # counts would look like an error of the step (docs/model/numerics.md)
        core = ramped_core(values)
        supply = values["drive.supply_voltage"]
        angle, angles = 0.0, [0.0]
        for k in range(round(STOP / step)):
            begin, end = k * step, (k + 1) * step
            inputs = codegen.inputs_at_rest(self.command(begin), self.torque(angle), supply)
            rise = (self.command(end) - inputs[0]) / step
            ramp = (begin, codegen.inputs_at_rest(rise, 0.0, 0.0)[:-1]) if self.ramped else None
            angle = core.run(end, inputs, ramp)[0]
            angles.append(degrees(angle))
        return angles


def _sine(time: float) -> float:
    return radians(5.0) * sin(2.0 * pi * 3.0 * time)


LOOPS = (
    Loop("command held", _sine, lambda angle: 0.0),
    Loop("command with its derivative", _sine, lambda angle: 0.0, ramped=True),
    Loop("hinge moment from the last angle", lambda time: radians(10.0), lambda angle: -300.0 * angle),
)


def steps() -> str:
    """Return the table of the largest error of the fin angle for each communication step."""
    rows = [[f"{step * 1e3:g} ms"] for step in STEPS]
    for loop in LOOPS:
        fine = loop.angles(FINE)
        for row, step in zip(rows, STEPS, strict=True):
            every = round(step / FINE)
            error = max(abs(a - b) for a, b in zip(loop.angles(step), fine[::every], strict=True))
            row.append(f"{error:.2g}°" if error > ROUNDING else "none")
    return markdown(("communication step", *(loop.title for loop in LOOPS)), rows)


def bus() -> str:
    """Return the table of largest current and lowest voltage of a bus whose four fins step 17 deg together."""
    values, rows = load_parameters().values, []
    for resistance in (0.0, 0.02, 0.05):
        run = simulate_fins([values] * 4, 0.06, FINE, line={"bus.source_resistance": resistance},
                            fin_command=radians(17.0))
        rows.append((f"{resistance * 1e3:g} mΩ", f"{run['bus_current'].max():.0f} A",
                     f"{run['bus_voltage'].min():.1f} V"))
    return markdown(("`bus.source_resistance`", "largest current", "lowest voltage"), rows)


def drift() -> str:
    """Return the first rows that `emcas baseline check` prints after a gain has changed by 1 %, and its last table."""
    folder, gain = DOCS, "controller.position.kp"
    shipped = load_parameters()
    subject = ParameterSubject(shipped)
    approved = record(first(subject)[0], subject, folder, "")
    changed = shipped.with_values({gain: round(1.01 * float(shipped.values[gain]), 6)})
    comparison = compare(approved, ParameterSubject(changed), folder)
    (header, rows), parameters = output.tables(comparison, False)
    return (f"{output.markdown(header, rows[:SHOWN])}\n\nand ends with\n\n{output.markdown(*parameters)}\n\n"
            f"`{comparison.verdict}`")


def _angle(model: str, chosen: Excitation) -> np.ndarray:
    """Return a model's fin angle [rad] under an excitation, without inputs and parameters that the model lacks."""
    parameters = load_parameters(model=model)
    signals: dict[str, Any] = {v.name.replace(".", "__"): chosen.columns[v.name] for v in get(model).inputs
                               if v.name in chosen.columns}
    return simulate(parameters.with_values(parameters.having(chosen.start_values)).values, chosen.stop, chosen.step,
                    model=model, **signals)["fin_angle"]


def _over(extension: str, model: str) -> str:
    """Return "yes" if an actuator can have an extension, otherwise ""; for `faults` the numbers of faults and monitors.
    """
    actuator = get(model)
    if not actuator.provides.issuperset(get_extension(extension).needs):
        return ""
    if extension == "faults":
        return f"{len(fault_list.possible(actuator))} faults, {len(monitors.possible(actuator))} monitors"
    return "yes"


def provided() -> str:
    """Return the table of the capabilities, extensions and numbers of variables of each actuator."""
    rows = [[words, *("yes" if words in get(model).provides else "" for model in NAMES)]
            for words in capabilities.NEEDED_VARIABLES]
    rows += [[f"`+{name}`", *(_over(name, model) for model in NAMES)] for name in EXTENSIONS]
    rows += [[f"number of {kind}", *(str(len(getattr(get(model), kind))) for model in NAMES)]
             for kind in ("states", "inputs", "outputs", "parameters")]
    return markdown(("provides", *NAMES), rows)


def needs() -> str:
    """Return the table of the needs of extensions and tools; those that are not listed need only the fin port."""
    uses: dict[str, Iterable[str]] = {f"`+{name}`": get_extension(name).needs for name in EXTENSIONS}
    uses |= {f"`+faults`, fault {fault.name}": (" or ".join(fault.needs),)
             for fault in fault_list.FAULTS if fault.needs}
    uses |= {f"`+faults`, monitor {monitor.name}": monitor.needs for monitor in monitors.MONITORS if monitor.needs}
    uses["`+heat`, I²t limit"] = (capabilities.CURRENT_LIMIT,)
    uses["`emcas analyse`, margins in requirements"] = (capabilities.POSITION_LOOP,)
    uses |= {f"`emcas analyse`, {name} loop": names for name, names in LINEAR_LOOPS.items() if name != "reference"}
    uses |= {f"`emcas analyse`, {title}": names for title, names in SECTIONS.values()}
    uses["`emcas envelope`"] = ("the extension heat", *envelope.NEEDS)
    uses["`emcas parameters`, stall and rates"] = capability.NEEDS
    uses["`emcas compare` without names, readings of the current loop"] = (capabilities.CURRENT_LOOP,)
    uses |= {f"`emcas {name}`": ("the nonlinear actuator",) for name in ("fit", "identify")}
    return markdown(("extension or tool", "needs"),
                    ([name, ", ".join(names) or "only the fin port"] for name, names in uses.items()))


def declares() -> str:
    """Return the table of the variables and states that an actuator with a capability declares."""
    def listed(names: Iterable[str]) -> str:
        return ", ".join(f"`{name}`" for name in names)

    constants = {words: name for name, words in vars(capabilities).items() if isinstance(words, str)}
    rows = [[f"{words}, `{constants[words]}`", listed(names), listed(capabilities.NEEDED_STATES[words]),
             listed(name for name in capabilities.NEEDED_PARAMETERS[words] if name not in names)]
            for words, names in capabilities.NEEDED_VARIABLES.items()]
    return markdown(("capability", "inputs, outputs, parameters", "states", "parameters of shared equations"), rows)


def extensions() -> str:
    """Return the table of the extensions, with the capabilities they need and the inputs and outputs they add."""
    rows = []
    for name in EXTENSIONS:
        extension = get_extension(name)
        page = {**dict.fromkeys(("stribeck", "lugre", "uneven"), "friction"),
                **dict.fromkeys(("saturation", "inverter"), "drive"),
                **dict.fromkeys(("filters", "trajectory"), "control")}.get(name, name)
        model = next(model for model in NAMES if _over(name, model))
        plain = {v.name for v in (*get(model).inputs, *get(model).outputs)}
        extended = get(f"{model}+{name}")
        added = [v.name for v in (*extended.inputs, *extended.outputs) if v.name not in plain]
        rows.append([f"[`{name}`]({page}.md)", extension.title,
                     ", ".join(extension.needs) or "only the fin port", ", ".join(extension.replaces),
                     ", ".join(f"`{each}`" for each in added)])
    return markdown(("extension", "description", "needs", "replaces", "adds"), rows)


def models() -> str:
    """Return the table of largest and rms difference of each model from the nonlinear one in the reference cases."""
    others = [name for name in MODELS if name != NONLINEAR]
    rows = []
    for case in CASES:
        chosen = reference_case(case.name)
        angles = {name: _angle(name, chosen) for name in MODELS}
        apart = [np.degrees(np.abs(angles[name] - angles[NONLINEAR])) for name in others]
        rows.append([f"`{case.name}`", *(f"{a.max():.2g}°, {np.sqrt(np.mean(a**2)):.2g}°" for a in apart)])
    return markdown(("reference case", *others), rows)


def _step(model: str, size: float, *, encoder: bool = True) -> np.ndarray:
    """Return the fin angle [rad] during 0.4 s of an unloaded step of `size` [deg]."""
    parameters = load_parameters(model=model)
    values = {"encoder.enabled": False} if not encoder and "encoder.enabled" in parameters.values else {}
    return simulate(parameters.with_values(values).values, 0.4, model=model, fin_command=radians(size))["fin_angle"]


def linear() -> str:
    """Return the table of the linear model's differences from the nonlinear one in unloaded steps, without encoder."""
    sizes = (1.0, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0)
    apart = (degrees(max(np.abs(_step("linear", sign * size) - _step(NONLINEAR, sign * size, encoder=False)).max()
                         for sign in (1.0, -1.0))) for size in sizes)
    return markdown(("step", *(f"{size:g}°" for size in sizes)), [("`linear`", *(f"{a:.2g}°" for a in apart))])


def fitted() -> str:
    """Return the second-order parameters that `emcas fit` fits, and the table of differences in unloaded steps."""
    v = fit(load_parameters()).figures()
    values = v["parameters"]
    head = (f"{values['second_order.natural_frequency']:.1f} rad/s, damping {values['second_order.damping']:.2f}, "
            f"rate limit {degrees(values['second_order.rate_limit']):.0f}°/s, delay "
            f"{1e3 * values['drive.transport_delay']:.1f} ms:")
    rows = [(f"`second-order`, {words}", *(f"{each:.2g} %" for each in v[name]))
            for words, name in (("largest", "largest_difference_percent"), ("rms", "rms_difference_percent"))]
    return f"{head}\n\n" + markdown(("step", *(f"{size:g}°" for size in v["step_deg"])), rows)


def structures() -> str:
    """Return the table of the largest differences of `elastic`, `habibi` and `ozkan` from `nonlinear` in steps."""
    sizes = (1.0, 5.0, 20.0)
    rows = [[f"`{model}`", *(f"{degrees(np.abs(_step(model, size) - _step(NONLINEAR, size)).max()):.2g}°"
                             for size in sizes)] for model in ("elastic", "habibi", "ozkan")]
    return markdown(("", *(f"{size:g}°" for size in sizes)), rows)


def presets() -> str:
    """Return the table of Table 2's figures for the readings of the current loop's gains, bold if a limit is missed."""
    comparison = sets.compare(sets.load_sets(sets.DRIVES[1:], NONLINEAR))
    rows = [[name.replace("drive.", "`drive.") + "`", "", *(f"{value:g}" for value in values)]
            for name, values in comparison.differing.items()]
    for row in (row for row in comparison.rows if "Table 2" in row[0].source):
        first, figures = row[0], [with_unit(j.measured, j.unit) for j in row]
        rows.append([first.title.replace("N.m", "N·m"),
                     f"{'≥' if first.sense == '>=' else '≤'} {with_unit(first.limit, first.unit)}",
                     *(figure if j.passed else f"**{figure}**" for j, figure in zip(row, figures, strict=True))])
    return markdown(("", "required", *(f"`{column.name}`" for column in comparison.columns)), rows)


def requirements() -> str:
    """Return the table of the shipped requirements, with their limits, measurement, and source or reason."""
    rows = []
    for r in load_requirements(None, load_parameters()).requirements:
        unit, factor = r.shown
        limit = f"{'≥' if r.sense == 'minimum' else '≤'} {with_unit(round(r.limit * factor, 9), unit)}"
        rows.append([f"`{r.name}`" + (" *" if r.optional else ""), r.title, limit, r.how, r.reason or r.source])
    return markdown(("name", "requirement", "limit", "how it is measured", "source or reason"),
                    [[cell.replace("N.m", "N·m").replace("|", "\\|") for cell in row] for row in rows])


def figures_of_tests() -> str:
    """Return the table of the kinds of excitation, with the figures of each."""
    return markdown(("kind", "figures"), [(f"`{kind}`", ", ".join(f"`{name}`" for name in each.figures))
                                          for kind, each in TESTS.items()])


def figures() -> str:
    """Return the table of the figures that requirements may have, with unit and description."""
    names = dict.fromkeys(name for each in TESTS.values() for name in each.figures)
    return markdown(("figure", "unit", "description"), [
        (f"`{name}`", {"1": "1 or %"}.get(FIGURES[name].unit, FIGURES[name].unit),
         FIGURES[name].title + (f" (needs `{FIGURES[name].needs[0]}`)" if FIGURES[name].needs[:1] not in (
             (), ("fin_angle",), ("fin_rate",)) else "")) for name in names])


def slopes() -> str:
    """Return the table of slope and offset of the motor current over references held at rest, for each drive set."""
    volts = np.linspace(-4.0, 4.0, 17)
    rows = []
    for name in sets.DRIVES[1:]:
        values = load_parameters(name).values
        gains = [values[f"drive.{key}"] for key in ("current_gain", "current_offset", "transport_delay", "kp", "ki")]
        lines = []
        for time, count in ((0.05, 50), (1.0, 100), (60.0, 600), (300.0, 300)):
            reference = (np.array([0.0] + [volt] * count) for volt in volts)
            currents = [response(gains, 0.0, column, None, time / count, values)[-1] for column in reference]
            lines.append(np.polyfit(volts, currents, 1))
        rows.append([f"`{name}`", *(f"{slope:.2f} A/V" for slope, _ in lines), f"{lines[0][1]:.4f} A"])
    return markdown(("", "after 50 ms", "1 s", "1 min", "5 min", "offset after 50 ms"), rows)


def sheets() -> str:
    """Return the table of the parameters that a user reads from a data sheet, drawing or controller, by sheet."""
    rows: dict[tuple[str, str], tuple[dict[str, str], list[str]]] = {}
    extended = [(each, v) for each in EXTENSIONS for v in get_extension(each).parameters(get(NONLINEAR))]
    for owner, v in (*((name, v) for name in NAMES for v in get(name).file_entries), *extended):
        sheet, _, term = v.sheet.partition(": ")
        if term:
            units, owners = rows.setdefault((sheet, term), ({}, []))
            units[v.name.partition("[")[0]] = "" if v.unit in ("", "1") else v.unit
            owners.append(owner)
    return markdown(("sheet", "name there", "parameter", "unit", "actuators, if not the default"), (
        (sheet, term.replace("|", "\\|"), ", ".join(f"`{name}`" for name in units),
         ", ".join(dict.fromkeys(filter(None, units.values()))),
         "" if NONLINEAR in owners else ", ".join(f"`{owner}`" for owner in dict.fromkeys(owners)))
        for (sheet, term), (units, owners) in sorted(rows.items(), key=lambda row: row[0][0])))


TABLES: Mapping[str, Mapping[str, Callable[[], str]]] = {
    "use/hosts.md": {"single": single, "several": several, "steps": steps}, "use/fins.md": {"bus": bus},
    "use/your_actuator.md": {"sheets": sheets},
    "tools/ci.md": {"drift": drift},
    "model/models.md": {"provided": provided, "needs": needs, "declares": declares, "extensions": extensions,
                        "models": models, "linear": linear, "fitted": fitted},
    "model/elastic.md": {"structures": structures},
    "use/requirements.md": {"requirements": requirements, "kinds": figures_of_tests, "figures": figures},
    "model/drive.md": {"slopes": slopes, "presets": presets}}


def renewed(text: str, tables: Mapping[str, Callable[[], str]]) -> str:
    """Return a document with new tables between its markers. Raises ValueError if a marker is missing or repeated."""
    for name, make in tables.items():
        pattern = re.compile(rf"(<!-- {name} -->\n).*?(\n<!-- /{name} -->)", re.DOTALL)
        if len(pattern.findall(text)) != 1:
            raise ValueError(f"needs <!-- {name} --> and <!-- /{name} --> once")
        table = f"\n{make()}\n"  # Markdown needs the blank lines around a table
        text = pattern.sub(lambda match: match[1] + table + match[2], text)  # noqa: B023
    return text


def main(check: bool, documents: Mapping[str, Mapping[str, Callable[[], str]]] = TABLES,
         script: str = "make_tables.py") -> int:
    """Write the documents and return 0; with `check` print those that are stale, and return 1 if there is one."""
    stale = 0
    for name, tables in documents.items():
        path = DOCS / name
        old = path.read_text(encoding="utf-8")
        new = renewed(old, tables)
        if new != old and check:
            print(f"docs/{name} is stale: run python docs/figures/{script}")
            stale = 1
        elif new != old:
            path.write_text(new, encoding="utf-8", newline="\n")
    return stale


if __name__ == "__main__":
    sys.exit(main("--check" in sys.argv[1:]))
