/* The responses of case B, or of the cases A and B, as curves and tables. */

const words = name => name.replace(/_/g, " ").replace(/\b3db\b/, "at −3 dB").replace(/\b90deg\b/, "at −90°");

/** The label of a curve, with the case's letter if there are two cases. */
const caseLabel = (cases, letter, label) => cases.length > 1 ? `${label} ${letter}` : label;
const lookOf = letter => letter === "A" ? {stroke: COLORS[1], dash: [7, 4]} : {stroke: COLORS[0]};

/** The texts of all cases, with their letters if there are two cases. */
const caseTexts = (cases, text) =>
    cases.map(([letter, each]) => (cases.length > 1 ? `${letter}: ` : "") + text(each)).join(". ");

function withUnit(value, unit) {
    const text = shownNumber(value);
    return /\d$/.test(text) && unit ? `${text}${/^°(?!C)/.test(unit) ? "" : " "}${unit}` : text;
}

function inUnit(name, value) {
    const [unit, factor] = DATA.figures[name].shown;
    return withUnit(value / factor, unit);
}

/** The function that converts a value of a panel to words, an item or the set flags; undefined if it is a number. */
function toWords({items, bits}) {
    if (items.length) return value => items[value - 1] ?? "–";
    const flags = value => bits.filter((_, bit) => value >> bit & 1).map(words).join(", ") || "none";
    return bits.length ? flags : undefined;
}

/** The traces of a response in a panel, in display units: one per output, or stacked, one for each of `flags` (bit
    numbers). */
function traces({names, bits, shown: [, factor]}, outputs, flags) {
    if (!bits.length) return names.map(name => ({label: words(name), y: outputs[name].map(x => x / factor)}));
    const word = outputs[names[0]], value = (_, v) => v === null ? "" : v % 1 ? "set" : "clear";
    if (!flags.length) return [{label: words(names[0]), y: word.map(() => 0), value: () => ""}];
    return flags.map((bit, row) => (
        {label: words(bits[bit]), y: word.map(x => row + 0.6 * (x >> bit & 1)), value}));
}

/** Plots a panel over time: its outputs, dashed for case A, and in the first panel also the command. */
function drawPanel(plot, panel, number, cases) {
    const [, factor] = panel.shown, live = cases.at(-1)[1].run, {time, columns} = live.excitation;
    const flags = panel.bits.map((_, bit) => bit).filter(bit => cases.some(([, {run}]) =>
        run.outputs[panel.names[0]].some(word => word >> bit & 1)));
    const value = panel.items.length ? (_, v) => v === null ? "" : toWords(panel)(v) : undefined;
    plot.ticks = panel.items.length ? panel.items.map((item, k) => [k + 1, item]) :
        panel.bits.length && !flags.length ? [[0, "none"]] :
        flags.map((bit, row) => [row, words(panel.bits[bit])]);
    const curves = cases.flatMap(([letter, {run}]) => traces(panel, run.outputs, flags).map((trace, k) => ({
        value, ...trace, label: caseLabel(cases, letter, trace.label), x: run.excitation.time,
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
    plot.over = u => panel.rules.forEach(([value, text], k) => {
        rule(u, "y", value, text, k > 0);
        rule(u, "y", -value, "");
    });
    plot.draw(curves);
}

/** Plots motor torque over motor speed, with the steady limits of current and supply in the live case. */
function drawPlane(plot, actuator, cases) {
    const {supply, speed: [, size], torque: [, unit]} = DATA.plane, [, {setting}] = cases.at(-1);
    const runs = cases.map(([letter, {run: {outputs}}]) =>
        ({letter, speed: outputs.motor_speed, torque: outputs.motor_torque}));
    const fastest = largest(runs.map(({speed}) => magnitude(speed))), volts = Number(setting.get(supply));
    let end = Math.max(1.2 * fastest, 1);  // rad/s, raised to a speed at which the supply allows no torque
    while (actuator.limitTorques(setting.parameters, volts, [end])[0] > 0 && end < 1e6) end *= 1.2;
    const speeds = Float64Array.from({length: 201}, (_, k) => end * (k - 100) / 100);
    const most = actuator.limitTorques(setting.parameters, volts, speeds).map(x => x / unit);
    const x = speeds.map(w => w / size), look = {x, stroke: gray, width: 1.2};
    const lines = runs.map(({letter, speed, torque}) =>
        ({...lookOf(letter), x: speed.map(w => w / size), y: torque.map(t => t / unit)}));
    const reached = largest(lines.map(({y}) => magnitude(y)));
    plot.reach = [-reached, reached];
    plot.over = u => lines.forEach(line => trajectory(u, line));
    plot.draw([{...look, label: "largest", y: most},
        {...look, label: "smallest", y: most.map(t => -t).reverse(), dash: [2, 2]}]);
    plot.describe(`motor torque up to ${shownNumber(reached)} at speeds up to ${shownNumber(fastest / size)}; ` +
        `largest steady torque at rest ${shownNumber(most[100])}`);
}

/** Fills a table with headings (the first, one for each case, the others) and rows, whose first cell is a heading. */
function fill(table, [first, ...columns], cases, rows) {
    const values = cases.length > 1 ? cases.map(([letter]) => letter === "A" ? "A, kept" : "B, live") : ["value"];
    const heads = [first, ...values, ...columns].map((name, k, all) =>
        element("th", {scope: "col", class: k === all.length - 1 ? "how" : k ? "n" : ""}, name));
    table.tHead.rows[0].replaceChildren(...heads);
    table.tBodies[0].replaceChildren(...rows.map(([heading, ...cells]) => element("tr", {},
        element("th", {scope: "row"}, heading),
        ...cells.map(cell => cell instanceof Node ? cell : element("td", {class: "n"}, cell)))));
}

function drawFigures(table, cases) {
    const listed = Object.entries(DATA.figures).filter(([name]) => cases.some(([, each]) => name in each.figures));
    fill(table, ["figure", "definition"], cases, listed.map(([name, {title}]) => [words(name),
        ...cases.map(([, {figures}]) => name in figures ? inUnit(name, figures[name]) : "–"),
        element("td", {class: "how"}, title)]));
}

const JUDGED = DATA.requirements.filter(({left_out: leftOut}) => !leftOut);

const required = ({sense, limit, unit}) => `${sense === ">=" ? "≥" : "≤"} ${withUnit(limit, unit)}`;

/** Mark, value and worst case of a verdict as text. */
function verdictText({unit, cases}, {value, case: worst, bound, passed}) {
    const text = Number.isNaN(value) ? "no value" : `${bound}${withUnit(value, unit)}`;
    return `${passed ? "✓" : "✗"} ${text}${cases.length > 1 ? `, ${worst}` : ""}`;
}

function marginText({unit}, {margin, percent}) {
    if (!Number.isFinite(margin)) return "–";
    const share = Math.abs(percent) < 10 ? general(percent, 2) : percent.toFixed(0);
    const text = Number.isNaN(percent) ? withUnit(margin, unit) : `${share.replace("-", "−")} %`;
    return margin >= 0 ? `+${text}` : text;
}

/** Fills the list with the verdicts of case B, and the line with the missed requirements of each case. */
function drawStrip(list, line, cases) {
    const [, {verdicts}] = cases.at(-1);
    list.replaceChildren(...JUDGED.map(requirement => {
        const {title, name} = requirement, verdict = verdicts?.get(name);
        return element("li", {title: `${title}: required ${required(requirement)}`,
            class: verdict ? verdict.passed ? "pass" : "fail" : "quiet"}, element("span", {class: "what"}, title),
            element("span", {}, verdict ? verdictText(requirement, verdict) : "–"),
            element("span", {class: "margin"}, verdict ? marginText(requirement, verdict) : ""));
    }));
    line.textContent = verdicts ? caseTexts(cases, each => {
        const missed = JUDGED.filter(({name}) => !each.verdicts.get(name).passed);
        return missed.length ? `${missed.length} of ${JUDGED.length} requirements missed: ` +
            missed.map(({title}) => title).join("; ") : `all ${JUDGED.length} judged requirements met`;
    }) : "";
}

function drawRequirements(table, cases) {
    fill(table, ["requirement", "required", "how it is measured"], cases, DATA.requirements.map(requirement => {
        const {name, title, how, reason, left_out: leftOut} = requirement;
        const cells = cases.map(([, {verdicts}]) => {
            if (leftOut) return element("td", {class: "n skip"}, "not judged");
            const verdict = verdicts.get(name), margin = marginText(requirement, verdict);
            return element("td", {class: `n ${verdict.passed ? "pass" : "fail"}`},
                `${verdictText(requirement, verdict)} (${margin})`);
        });
        const why = element("span", {class: "quiet"}, reason && ` · ${reason}`);
        return [title, ...cells, required(requirement), element("td", {class: "how"}, leftOut || how, why)];
    }));
}

const DASHES = [undefined, [7, 4], [2, 3]];

function drawResponses(bode, cases) {
    const responses = cases.flatMap(([letter, each]) => each.responses.map(([label, response], k) => ({
        label: caseLabel(cases, letter, label), ...response, dash: DASHES[k % DASHES.length],
        stroke: lookOf(letter).stroke,
        marks: [{frequency: response.bandwidth_3db, gain: -3}, {frequency: response.bandwidth_90deg, phase: -90}]})));
    const bandwidth = JUDGED.find(({figure}) => figure === "bandwidth_3db");
    drawBode(bode, [[-3, "−3 dB"], [-90, "−90°"]], responses.filter(({frequency}) => frequency.length),
        bodeSummary(cases), bandwidth?.limit);
}

function bodeSummary(cases) {
    const where = {"< ": "below", "": "at", "> ": "above"};
    const at = x => x === undefined ? "without a value" : `${where[boundOf(x)]} ${shownNumber(x)} Hz`;
    const one = ([label, {bandwidth_3db: gain, bandwidth_90deg: lag}]) =>
        `${label}: −3 dB ${at(gain)}, −90° ${at(lag)}`;
    return caseTexts(cases, ({responses}) => responses.map(one).join("; "));
}
