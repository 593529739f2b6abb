"""Draw the picture of docs/develop/architecture.md: `python docs/figures/make_architecture.py`."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import escape

WIDTH, HEIGHT = 900, 806
INK, PAPER = "#1f2328", "#ffffff"
BLUE, GREEN, AMBER, VIOLET, GRAY = "#dcebfa", "#dff3e4", "#fdf0d5", "#ebe4f7", "#eef0f2"
FONT = "font-family='Helvetica, Arial, DejaVu Sans, sans-serif'"
LINE = 18  # px from one line of text to the next


class Box(NamedTuple):
    """A part of the package: position and size [px], colour, name, and lines that describe its contents."""

    x: int
    y: int
    width: int
    height: int
    fill: str
    name: str
    lines: tuple[str, ...] = ()
    step: str = ""  # number in the walk through the package
    dashed: bool = False

    def svg(self) -> str:
        """Return the box with its texts."""
        dash = " stroke-dasharray='6 4'" if self.dashed else ""
        parts = [f"<rect x='{self.x}' y='{self.y}' width='{self.width}' height='{self.height}' rx='6' "
                 f"fill='{self.fill}' stroke='{INK}' stroke-width='1'{dash}/>",
                 _text(self.x + 12, self.y + 22, self.name, 15, "bold")]
        parts += [_text(self.x + 12, self.y + 42 + LINE * i, line) for i, line in enumerate(self.lines)]
        if self.step:
            x, y = self.x + self.width - 18, self.y + 18
            parts += [f"<circle cx='{x}' cy='{y}' r='11' fill='{INK}'/>",
                      _text(x, y + 5, self.step, 13, "bold", PAPER, "middle")]
        return "\n".join(parts)


def _text(x: int, y: int, text: str, size: int = 13, weight: str = "normal", fill: str = INK,
          anchor: str = "start") -> str:
    return (f"<text x='{x}' y='{y}' font-size='{size}' font-weight='{weight}' fill='{fill}' text-anchor='{anchor}'>"
            f"{escape(text)}</text>")


def _arrow(*points: tuple[int, int]) -> str:
    path = " ".join(f"{x},{y}" for x, y in points)
    return f"<polyline points='{path}' fill='none' stroke='{INK}' stroke-width='1.5' marker-end='url(#head)'/>"


BOXES = (
    Box(10, 10, 640, 52, GRAY, "commands/ · cli.py", (
        "build · simulate · validate · report · baseline · tune · campaign · analyse …",)),
    Box(10, 76, 146, 52, VIOLET, "ssp/", ("archives of fins",)),
    Box(170, 76, 480, 52, VIOLET, "studies/", ("validation · report · baseline · tuning · campaign · analysis …",)),
    Box(10, 142, 640, 52, VIOLET, "bench/", (
        "one way to excite, run, measure and judge, for every actuator or FMU · pages/: their HTML",)),
    Box(10, 208, 640, 70, BLUE, "fmi/", (
        "interface of one fin or several · model description · documentation · package",
        "common/: an instance in C for both versions · fmi2/: fmi2.c, slave.py · fmi3/: fmi3.c"), "1"),
    Box(10, 292, 640, 88, BLUE, "runtime/", (
        "codegen · compiled · batch: an actuator, or many at once, as a program in Python and C",
        "core.py and core.h, the same in both: samples, delay line, ticks, events",
        "multi_fin.py and multi_fin.h: several fins on one line · schedule"), "2"),
    Box(10, 394, 200, 268, BLUE, "trace/", (
        "tracer: runs a function", "once, over symbols, and", "notes what it does", "",
        "python_source · c_source ·", "vector_source: the notes as", "straight-line code")),
    Box(224, 394, 426, 70, GREEN, "extensions/ · an actuator in, an actuator out", (
        "stribeck · lugre · uneven · efficiency · saturation · inverter ·",
        "sensors · heat · filters · homing · trajectory · supply · faults")),
    Box(224, 478, 426, 106, GREEN, "actuators/", (
        "declaration: states, variables, rules, equations",
        "fin_port: the variables of all · capabilities: of some",
        "composition: groups in electromechanical/ · hydraulic/",
        "external: the one in your own file"), "3"),
    Box(224, 598, 250, 64, GREEN, "steppers/", ("rigid · elastic · lugre · smooth",), "5"),
    Box(488, 598, 162, 64, GREEN, "control/", ("controllers · sensors",), "4"),
    Box(10, 676, 640, 52, GREEN, "physics/", (
        "kinematics · mechanics · friction · screw · drive · loads · heat · bus …",), "6"),
    Box(10, 742, 640, 52, GRAY, "ops/", (
        "the operations of the equations: on floats, arrays, symbols, or the tracer",)),
    Box(680, 10, 210, 184, AMBER, "reference/", (
        "independent integrations", "by SciPy: share no equation", "with the rest", "",
        "studies/ compare with them", "what the FMU computes"), "", True),
    Box(680, 292, 210, 172, AMBER, "parameters/", (
        "files in layers over the", "defaults, units by pint,", "rules that must hold", "",
        "sets · entries · schema;", "variables · units · rules")),
    Box(680, 478, 210, 184, AMBER, "models/", (
        "emcas.toml: the default set", "actuators/ · extensions/:", "what differs, each number", "with its source", "",
        "reference/: stored", "responses")),
)
ARROWS = (
    _arrow((650, 102), (680, 102)),  # studies compare with references
    _arrow((110, 394), (110, 380)),  # traced functions become the program
    _arrow((224, 530), (210, 530)),  # the declaration's functions are traced
    _arrow((785, 478), (785, 464)),  # parameter files are read
    _arrow((680, 340), (650, 340)),  # and their values enter the program
)


def picture() -> str:
    """Return the picture as SVG."""
    body = "\n".join([*(box.svg() for box in BOXES), *ARROWS,
                      _text(680, 700, "1 to 6: the walk below", 13, "bold"),
                      _text(680, 722, "Each storey uses those"), _text(680, 740, "below it. Green is traced:"),
                      _text(680, 758, "no input or output, no"), _text(680, 776, "if on values.")])
    return (f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {WIDTH} {HEIGHT}' width='{WIDTH}' "
            f"height='{HEIGHT}' {FONT}>\n<title>The package emcas_fmu</title>\n<defs><marker id='head' "
            "viewBox='0 0 10 10' refX='9' refY='5' markerWidth='7' markerHeight='7' orient='auto'>"
            f"<path d='M0,0 L10,5 L0,10 z' fill='{INK}'/></marker></defs>\n"
            f"<rect width='100%' height='100%' fill='{PAPER}'/>\n{body}\n</svg>\n")


if __name__ == "__main__":
    Path(__file__).with_name("architecture.svg").write_text(picture(), encoding="utf-8", newline="\n")
