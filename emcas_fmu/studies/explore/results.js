"use strict";
/* The response as curves and tables: of one case, or of A and B. */

const typeset = unit => DATA.typeset[unit] ?? unit;
const words = name => name.replace(/_/g, " ").replace(/\b3db\b/, "at −3 dB").replace(/\b90deg\b/, "at −90°");

/** A figure with its unit, as people read it. */
function inUnit(name, value) {
    const [unit, factor] = DATA.figures[name].shown, text = shownNumber(value / factor), symbol = typeset(unit);
    return /\d$/.test(text) && symbol ? `${text}${symbol.startsWith("°") ? "" : " "}${symbol}` : text;
}

/** How a panel's values are said: an enumeration's item, the flags that are set; undefined for numbers. */
function named({items, bits}) {
    if (items.length) return value => items[value - 1] ?? "–";
    const flags = value => bits.filter((_, bit) => value >> bit & 1).map(words).join(", ") || "none";
    return bits.length ? flags : undefined;
}

/** What a panel draws of a response: its outputs as shown; of a word of `flags` a trace each, one above the other. */
function traces({names, bits, shown: [, factor]}, outputs, flags) {
    if (!bits.length) return names.map(name => ({label: words(name), y: outputs[name].map(x => x / factor)}));
    const word = outputs[names[0]], value = (_, v) => v === null ? "" : v % 1 ? "set" : "clear";
    if (!flags.length) return [{label: words(names[0]), y: word.map(() => 0), value: () => ""}];
    return flags.map((bit, place) => (
        {label: words(bits[bit]), y: word.map(x => place + 0.6 * (x >> bit & 1)), value}));
}

/** The curves of a panel over time: every output, of A dashed; with the first one the command. */
function drawPanel(plot, panel, number, cases) {
    const [, factor] = panel.shown, live = cases[cases.length - 1][1].run, {time, columns} = live.excitation;
    const flags = panel.bits.map((_, bit) => bit).filter(bit => cases.some(([, {run}]) =>
        run.outputs[panel.names[0]].some(word => word >> bit & 1)));
    const value = panel.items.length ? (_, v) => v === null ? "" : named(panel)(v) : undefined;
    plot.ticks = panel.items.length ? panel.items.map((item, k) => [k + 1, item]) :
        panel.bits.length && !flags.length ? [[0, "none"]] :
        flags.map((bit, place) => [place, words(panel.bits[bit])]);
    const curves = cases.flatMap(([letter, {run}]) => traces(panel, run.outputs, flags).map(({label, y, ...how}, k) => ({
        value, ...how, label: label + (cases.length > 1 ? ` ${letter}` : ""), x: run.excitation.time, y,
        step: panel.discrete, stroke: COLORS[(k + Number(letter === "A" && panel.names.length === 1)) % COLORS.length],
        ...(letter === "A" ? {dash: [7, 4], width: 1.3} : {})})));
    const command = number === 0 && columns.fin_command?.map(x => x / factor);
    if (command) {
        curves.push({label: "command", x: time, y: command, stroke: gray, dash: [2, 2], width: 1.1, step: true});
    }
    plot.under = u => {
        if (live.outputs.saturated) shade(u, time, live.outputs.saturated);
        if (command) band(u, time, command, DATA.constants.ACCURACY / factor);
    };
    plot.over = u => {
        panel.rules.forEach(([value, text], k) => {
            rule(u, "y", value, text, k > 0);
            rule(u, "y", -value, "");
        });
    };
    plot.draw(curves);
}

/** A table's body: rows of cells, the first of each a heading. */
function fill(body, rows) {
    body.replaceChildren(...rows.map(([heading, ...cells]) => element("tr", {}, element("th", {scope: "row"}, heading),
        ...cells.map(cell => cell instanceof Node ? cell : element("td", {class: "n"}, cell)))));
}

function drawFigures(table, cases) {
    const names = Object.keys(DATA.figures).filter(name => cases.some(([, each]) => name in each.figures));
    $("figures-head").replaceChildren(...headings("figure", cases, ["definition"]));
    fill(table, names.map(name => [words(name),
        ...cases.map(([, each]) => name in each.figures ? inUnit(name, each.figures[name]) : "–"),
        element("td", {class: "how"}, DATA.figures[name].title)]));
}

function headings(first, cases, more) {
    const names = cases.length > 1 ? cases.map(([letter]) => letter === "A" ? "A, kept" : "B, live") : ["value"];
    return [element("th", {scope: "col"}, first), ...names.map(name => element("th", {scope: "col", class: "n"}, name)),
        ...more.map(name => element("th", {scope: "col", class: name === "required" ? "n" : "how"}, name))];
}

/** What is measured for a requirement, and whether it is met: {value, beyond, passed}. */
function judged(requirement, runs) {
    const needed = requirement.needs.map(name => runs[name]);
    if (needed.some(run => run.stopped)) return {value: NaN, passed: false};
    let value = MEASURES[requirement.measure](needed), beyond = false;
    if (requirement.measure === "bandwidth" && Number.isNaN(value)) {
        const {frequency} = needed[0].frequency;
        [value, beyond] = [frequency[frequency.length - 1], true];
    }
    const passed = requirement.sense === ">=" ? value >= requirement.limit : value <= requirement.limit;
    return {value, beyond, passed};
}

function drawRequirements(table, cases) {
    $("requirements-head").replaceChildren(...headings("requirement", cases, ["required", "how it is measured"]));
    fill(table, DATA.requirements.map(requirement => {
        const unit = typeset(requirement.unit), gap = unit.startsWith("°") ? "" : " ";
        const cells = cases.map(([, each]) => {
            const {value, beyond, passed} = judged(requirement, each.runs);
            return element("td", {class: `n ${passed ? "pass" : "fail"}`},
                `${passed ? "✓" : "✗"} ${beyond ? "> " : ""}${shownNumber(value)}${gap}${unit}`);
        });
        const limit = `${requirement.sense === ">=" ? "≥" : "≤"} ${shownNumber(requirement.limit)}${gap}${unit}`;
        return [requirement.title, ...cells, limit, element("td", {class: "how"}, requirement.how)];
    }));
}

/** The sweeps there are: of Table 2, and the excitation where it is one. */
function sweeps(each) {
    const chirp = each.setting.shape === "chirp" && {
        "this chirp": each.chirp ??= {frequency: frequencyResponse(each.run)}};
    const listed = Object.entries(DATA.runs).filter(([, run]) => run.sweep).map(([name, run]) =>
        [`${shownNumber(degrees(run.sweep.amplitude))}°`, each.runs[name]]);
    return [...listed, ...Object.entries(chirp || {})].filter(([, run]) => run.frequency?.frequency.length);
}

const DASHES = [undefined, [7, 4], [2, 3]];

function drawBode(gain, phase, cases) {
    const two = cases.length > 1;
    const responses = cases.flatMap(([letter, each]) => sweeps(each).map(([label, {frequency}], k) => ({
        label: two ? `${label} ${letter}` : label, frequency, dash: DASHES[k],
        stroke: COLORS[letter === "A" ? 1 : 0]})));
    const curves = part => responses.map(({frequency, ...look}) => (
        {...look, x: frequency.frequency, y: frequency[part].map(part === "phase" ? degrees : x => x)}));
    const required = DATA.requirements.find(({measure}) => measure === "bandwidth");
    gain.under = u => forbidden(u, required.limit, -3);
    gain.over = u => {
        rule(u, "y", -3, "−3 dB");
        rule(u, "x", required.limit, `required ${shownNumber(required.limit)} Hz`);
        for (const {frequency: {bandwidth}, stroke} of responses) mark(u, bandwidth, -3, stroke());
    };
    phase.over = u => {
        rule(u, "y", -90, "−90°");
        for (const {frequency, stroke} of responses) mark(u, frequency.phase_bandwidth, -90, stroke());
    };
    gain.draw(curves("gain"));
    phase.draw(curves("phase"));
    gain.describe(bodeSummary(cases));
    phase.describe(bodeSummary(cases));
}

/** A ring at a point of a plot. */
function mark(u, x, y, stroke) {
    if (!Number.isFinite(x)) return;
    const {ctx} = u;
    ctx.save();
    [ctx.strokeStyle, ctx.fillStyle, ctx.lineWidth] = [stroke, color("--back")(), 2 * devicePixelRatio];
    ctx.setLineDash([]);
    ctx.beginPath();
    ctx.arc(u.valToPos(x, "x", true), u.valToPos(y, "y", true), 4 * devicePixelRatio, 0, 2 * Math.PI);
    ctx.fill();
    ctx.stroke();
    ctx.restore();
}

function bodeSummary(cases) {
    const at = (x, {frequency}) => Number.isFinite(x) ? `at ${shownNumber(x)} Hz` :
        `above ${shownNumber(frequency[frequency.length - 1])} Hz`;
    const one = ([label, {frequency}]) => `${label}: −3 dB ${at(frequency.bandwidth, frequency)}, ` +
        `−90° ${at(frequency.phase_bandwidth, frequency)}`;
    return cases.map(([letter, each]) =>
        (cases.length > 1 ? `${letter}: ` : "") + sweeps(each).map(one).join("; ")).join(". ");
}
