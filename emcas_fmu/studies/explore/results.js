"use strict";
/* The responses of one case, or of A and B, as curves and tables. */

const typeset = unit => DATA.typeset[unit] ?? unit;
const words = name => name.replace(/_/g, " ").replace(/\b3db\b/, "at −3 dB").replace(/\b90deg\b/, "at −90°");

/** A figure with its unit, for display. */
function inUnit(name, value) {
    const [unit, factor] = DATA.figures[name].shown, text = shownNumber(value / factor), symbol = typeset(unit);
    return /\d$/.test(text) && symbol ? `${text}${symbol.startsWith("°") ? "" : " "}${symbol}` : text;
}

/** The function from a panel's values to words: an enumeration's item, the flags that are set; undefined for numbers. */
function named({items, bits}) {
    if (items.length) return value => items[value - 1] ?? "–";
    const flags = value => bits.filter((_, bit) => value >> bit & 1).map(words).join(", ") || "none";
    return bits.length ? flags : undefined;
}

/** The traces of a response in a panel, in display units: one per output, or one per flag of `flags`, stacked. */
function traces({names, bits, shown: [, factor]}, outputs, flags) {
    if (!bits.length) return names.map(name => ({label: words(name), y: outputs[name].map(x => x / factor)}));
    const word = outputs[names[0]], value = (_, v) => v === null ? "" : v % 1 ? "set" : "clear";
    if (!flags.length) return [{label: words(names[0]), y: word.map(() => 0), value: () => ""}];
    return flags.map((bit, row) => (
        {label: words(bits[bit]), y: word.map(x => row + 0.6 * (x >> bit & 1)), value}));
}

/** Draws a panel over time: all outputs, those of A dashed; in the first panel also the command. */
function drawPanel(plot, panel, number, cases) {
    const [, factor] = panel.shown, live = cases[cases.length - 1][1].run, {time, columns} = live.excitation;
    const flags = panel.bits.map((_, bit) => bit).filter(bit => cases.some(([, {run}]) =>
        run.outputs[panel.names[0]].some(word => word >> bit & 1)));
    const value = panel.items.length ? (_, v) => v === null ? "" : named(panel)(v) : undefined;
    plot.ticks = panel.items.length ? panel.items.map((item, k) => [k + 1, item]) :
        panel.bits.length && !flags.length ? [[0, "none"]] :
        flags.map((bit, row) => [row, words(panel.bits[bit])]);
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

/** Fills a table's body with rows of cells, the first of each a heading. */
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

function drawRequirements(table, cases) {
    $("requirements-head").replaceChildren(...headings("requirement", cases, ["required", "how it is measured"]));
    fill(table, DATA.requirements.map(requirement => {
        const unit = typeset(requirement.unit), gap = unit.startsWith("°") ? "" : " ", more = [];
        const cells = cases.map(([, each]) => {
            if (requirement.left_out) return element("td", {class: "n skip"}, "not judged");
            const {value, case: worst, beyond, passed} = judged(requirement, each.measured);
            const text = Number.isNaN(value) ? "no value" : `${shownNumber(value)}${Number.isFinite(value) ? gap + unit : ""}`;
            const where = requirement.cases.length > 1 ? `, ${worst}` : "";
            return element("td", {class: `n ${passed ? "pass" : "fail"}`},
                `${passed ? "✓" : "✗"} ${beyond ? "> " : ""}${text}${where}`);
        });
        const limit = `${requirement.sense === ">=" ? "≥" : "≤"} ${shownNumber(requirement.limit)}${gap}${unit}`;
        const {how, reason, left_out: leftOut} = requirement;
        return [requirement.title, ...cells, limit, element("td", {class: "how"}, leftOut || how,
            element("span", {class: "quiet"}, reason && ` · ${reason}`))];
    }));
}

/** Amplitude [rad] and load [N.m] of the frequency responses: those of requirements, and of a sine or sweep that is set. */
function sinesOf(setting) {
    const required = DATA.tests.filter(({kind}) => kind === "sine").map(({amplitude}) => [amplitude, 0]);
    const wave = ["sine", "sweep"].includes(setting.kind), {amplitude, torque} = setting.fields, own = [amplitude, torque];
    const known = required.some(each => each.every((x, k) => x === own[k]));
    return wave && own[0] && !known ? [...required, own] : required;
}

const DASHES = [undefined, [7, 4], [2, 3]];

function drawBode(gain, phase, cases) {
    const two = cases.length > 1;
    const responses = cases.flatMap(([letter, each]) => each.responses.map(([label, response], k) => ({
        label: two ? `${label} ${letter}` : label, response, dash: DASHES[k % DASHES.length],
        stroke: COLORS[letter === "A" ? 1 : 0]}))).filter(({response}) => response.frequency.length);
    const curves = part => responses.map(({response, ...look}) => (
        {...look, x: response.frequency, y: response[part].map(part === "phase" ? degrees : x => x)}));
    const required = DATA.requirements.find(({figure, left_out: leftOut}) => figure === "bandwidth_3db" && !leftOut);
    gain.under = u => required && forbidden(u, required.limit, -3);
    gain.over = u => {
        rule(u, "y", -3, "−3 dB");
        if (required) rule(u, "x", required.limit, `required ${shownNumber(required.limit)} Hz`);
        for (const {response, stroke} of responses) mark(u, response.bandwidth_3db, -3, stroke());
    };
    phase.over = u => {
        rule(u, "y", -90, "−90°");
        for (const {response, stroke} of responses) mark(u, response.bandwidth_90deg, -90, stroke());
    };
    for (const [plot, part] of [[gain, "gain"], [phase, "phase"]]) {
        if (responses.length) plot.draw(curves(part));
        plot.figure.hidden = !responses.length;
        plot.describe(bodeSummary(cases));
    }
}

function bodeSummary(cases) {
    const at = x => x === undefined ? "without a value" :
        x < DATA.constants.BANDWIDTHS[1] ? `at ${shownNumber(x)} Hz` : `above ${shownNumber(x)} Hz`;
    const one = ([label, response]) => `${label}: −3 dB ${at(response.bandwidth_3db)}, −90° ${at(response.bandwidth_90deg)}`;
    return cases.map(([letter, each]) =>
        (cases.length > 1 ? `${letter}: ` : "") + each.responses.map(one).join("; ")).join(". ");
}
