"use strict";
/* Excitations: rows of inputs 1 ms apart, a port of bench/excitation.py. SI throughout. */

const STEP = DATA.constants.STEP;

function times(stop) {
    return Float64Array.from({length: Math.round(stop / STEP) + 1}, (_, k) => k * STEP);
}

/** A jump of the command at `begin` [s], with a load [N.m] that rises with it. */
function motionTo(level, from, begin, {duration, load}) {
    const time = times(begin + duration), clip = x => Math.min(Math.max(x, 0), 1);
    const command = time.map(t => t > begin - STEP / 2 ? level : from);
    command[0] = 0;
    const columns = {fin_command: command};
    if (load) columns.aero_torque = time.map(t => load * clip((t - begin) / DATA.constants.LOAD_RISE));
    return {time, columns, begin};
}

/** A sine of the command from rest; `phase` [rad] is a function of the time [s] since its begin. */
function wave(amplitude, duration, phase) {
    const begin = DATA.constants.LEAD_IN, time = times(begin + duration);
    const command = time.map(t => amplitude * Math.sin(phase(Math.max(t - begin, 0))));
    return {time, begin, columns: {fin_command: command}};
}

/** A logarithmic sweep between two frequencies [Hz]. */
function sweep({amplitude, low, high, duration}) {
    const [from, to] = [low, high].map(f => general(f, 6));
    if (!(low < high)) throw new Error(`the sweep's low = ${from} Hz is not below its high = ${to} Hz`);
    const growth = Math.log(high / low) / duration;
    return wave(amplitude, duration, since => 2 * Math.PI * low * Math.expm1(growth * since) / growth);
}

/** An excitation with a constant load. */
function underLoad(excitation, load) {
    if (load) excitation.columns.aero_torque = excitation.time.map(() => load);
    return excitation;
}

const SHAPES = {
    step: {title: "Step", fields: ["amplitude", "load", "duration"], amplitude: Math.PI / 18, duration: 0.5,
        build: s => motionTo(s.amplitude, 0, DATA.constants.LEAD_IN, s)},
    slew: {title: "Slew, from − to +", fields: ["amplitude", "load", "duration"], amplitude: Math.PI / 9, duration: 0.5,
        build: s => motionTo(s.amplitude, -s.amplitude, DATA.constants.SETTLE, s)},
    load: {title: "Load step", fields: ["load", "duration"], amplitude: 0, duration: 0.5, load: -DATA.load,
        build: s => motionTo(0, 0, DATA.constants.LEAD_IN, s)},
    sine: {title: "Sine", fields: ["amplitude", "frequency", "load", "duration"], amplitude: Math.PI / 180, duration: 1,
        build: s => underLoad(wave(s.amplitude, s.duration, since => 2 * Math.PI * s.frequency * since), s.load)},
    chirp: {title: "Chirp", fields: ["amplitude", "low", "high", "load", "duration"], amplitude: Math.PI / 180,
        duration: 12, build: s => underLoad(sweep(s), s.load)},
    csv: {title: "Your CSV", fields: ["load"], amplitude: 0, duration: 1,
        build: s => {
            if (!s.file) throw new Error("choose a CSV file: a column time [s] and columns of inputs, SI");
            const excitation = {time: s.file.time, begin: 0, columns: {...s.file.columns}};
            return "aero_torque" in excitation.columns ? excitation : underLoad(excitation, s.load);
        }},
};

/** The jumps of a command: instant [s], level, and when the next one comes or the rows end [s]. */
function moves(time, command) {
    const jumps = [];
    for (let k = 1; k < time.length; ++k) if (command[k] !== command[k - 1]) jumps.push(k);
    return jumps.map((row, i) => ({start: time[row], level: command[row], end: time[jumps[i + 1] ?? time.length - 1]}));
}

/** Rows of inputs from the text of a CSV file, linear between its rows, as in bench/excitation.py. Throws an Error. */
function fromCsv(text, title) {
    const lines = text.replace(/^\uFEFF/, "").split(/\r?\n/).filter(line => line.trim());
    const cells = line => line.split(",").map(cell => cell.trim().replace(/^"(.*)"$/, "$1"));
    const names = cells(lines.shift() ?? "");
    const rows = lines.map(line => cells(line).map(cell => cell === "" ? NaN : Number(cell)));
    const short = listed => listed.join(", ").replace(/[^\x20-\uFFFF]/g, "?").slice(0, 200);
    const known = DATA.inputs.map(v => v.name), unknown = names.filter(n => n !== "time" && !known.includes(n));
    const twice = names.find((name, i) => names.indexOf(name) !== i);
    const read = names.map((_, i) => rows.map(row => row[i])), at = names.indexOf("time"), time = read[at];
    const problem = at < 0 ? `has no column time; its columns are ${short(names)}` :
        twice ? `column ${twice} is given twice` :
        unknown.length ? `${short(unknown)} is not an input; inputs are ${known.join(", ")}` :
        names.length < 2 ? `has no column of an input; inputs are ${known.join(", ")}` :
        rows.length < 2 ? "needs two rows of numbers or more" :
        rows.some(row => row.length !== names.length || row.some(x => !Number.isFinite(x))) ?
            "has an empty or non-finite value, or a row of another length" :
        time[0] < 0 || time.some((t, k) => t < time[k - 1]) ? "time must begin at 0 or later and not run backwards" :
        unfit(time[time.length - 1]);
    if (problem) throw new Error(`${title}: ${problem}`);
    const points = times(time[time.length - 1]);
    const columns = names.map((name, i) => [name, sampled(points, time, read[i])]).filter(([name]) => name !== "time");
    return {title, time: points, columns: Object.fromEntries(columns)};
}

/** The problem with the time [s] of a file's last row; empty if there is none. */
function unfit(stop) {
    const steps = stop / STEP;
    if (!(steps >= 1 && steps <= DATA.constants.MOST_ROWS)) {
        return `the end at ${general(stop, 6)} s must be ${STEP} to ${DATA.constants.MOST_ROWS * STEP} s from 0`;
    }
    const whole = Math.abs(steps - Math.round(steps)) <= 1e-6;
    return whole ? "" : `the end at ${general(stop, 6)} s is not a whole number of steps of ${STEP} s`;
}

/** A column at points of time: linear between its rows, the later value at a jump, constant outside. */
function sampled(points, time, column) {
    let after = 0;
    return points.map(point => {
        while (after < time.length && time[after] <= point * (1 + 1e-12)) ++after;
        const low = Math.max(after - 1, 0), high = Math.min(after, time.length - 1), span = time[high] - time[low];
        const share = span > 0 ? Math.min(Math.max((point - time[low]) / span, 0), 1) : 0;
        return column[low] + share * (column[high] - column[low]);
    });
}
