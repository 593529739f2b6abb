/* Excitations, columns of inputs over time: a port of motions.py and bench/excitation.py. All values are in SI. */

const STEP = DATA.constants.STEP;

function times(stop) {
    return Float64Array.from({length: Math.round(stop / STEP) + 1}, (_, k) => k * STEP);
}

/** The command of each kind as a share of its amplitude, at a time [s] since the start of the motion. */
const SHARES = {
    step: since => Number(since > -STEP / 2),
    slew: since => since > -STEP / 2 ? 1 : -1,
    load: () => 0,
    sine: (since, {frequency}) => Math.sin(2 * Math.PI * frequency * Math.max(since, 0)),
    sweep: (since, {low, high, duration}) => {
        const growth = Math.log(high / low) / duration;
        return Math.sin(2 * Math.PI * low * Math.expm1(growth * Math.max(since, 0)) / growth);
    },
};

/** The excitation of a kind with these fields. Throws an Error for a sweep that does not rise. */
function excitationOf(kind, fields) {
    const {amplitude = 0, torque, duration, settle: begin = DATA.constants.LEAD_IN, low, high} = fields;
    if (low >= high) {
        const [from, to] = [low, high].map(f => general(f, 6));
        throw new Error(`the sweep's low = ${from} Hz is not below its high = ${to} Hz`);
    }
    const time = times(begin + duration), {rise} = DATA.kinds[kind];
    const columns = {fin_command: time.map((t, k) => k ? amplitude * SHARES[kind](t - begin, fields) : 0)};
    const risen = since => rise === null ? 1 : rise ? Math.min(Math.max(since / rise, 0), 1) : SHARES.step(since);
    if (torque) columns.aero_torque = time.map(t => torque * risen(t - begin));
    return {time, begin, columns};
}

/** The excitation of a CSV file, with a constant torque [N.m] if the file has none. Throws an Error without a file. */
function fileExcitation(file, torque) {
    if (!file) throw new Error("choose a CSV file: a column time [s] and columns of inputs, SI");
    const {time, columns} = file, constant = torque ? {aero_torque: time.map(() => torque)} : {};
    return {time, begin: 0, columns: {...constant, ...columns}};
}

/** The jumps of a command, each with its instant [s], the level [rad] after it, and the end [s]: the next jump or the
    last row. */
function moves(time, command) {
    const jumps = [];
    for (let k = 1; k < time.length; ++k) if (command[k] !== command[k - 1]) jumps.push(k);
    return jumps.map((row, i) => ({start: time[row], level: command[row], end: time[jumps[i + 1] ?? time.length - 1]}));
}

/** The inputs in the text of a CSV file, interpolated linearly at every step, as in bench/excitation.py. `points` are
    the rows of the command in the file. Throws an Error. */
function fromCsv(text, title) {
    const [names = [], ...lines] = text.replace(/^\uFEFF/, "").split(/\r?\n/).filter(line => line.trim()).map(line =>
        line.split(",").map(cell => cell.trim().replace(/^"(.*)"$/, "$1")));
    const rows = lines.map(cells => cells.map(cell => cell === "" ? NaN : Number(cell)));
    const column = name => rows.map(row => row[names.indexOf(name)]), time = column("time");
    const known = DATA.inputs.map(v => v.name), inputs = names.filter(name => name !== "time");
    const twice = names.find((name, i) => names.indexOf(name) !== i), unknown = inputs.filter(n => !known.includes(n));
    const stop = time[time.length - 1], steps = stop / STEP;
    const problem = !names.includes("time") ? `has no column time; its columns are ${inputs.join(", ")}` :
        twice ? `column ${twice} appears twice` :
        unknown.length ? `${unknown.join(", ")} is not an input; inputs are ${known.join(", ")}` :
        !inputs.length ? `has no column of an input; inputs are ${known.join(", ")}` :
        rows.length < 2 ? "needs two or more rows of numbers" :
        rows.some(row => row.length !== names.length || row.some(x => !Number.isFinite(x))) ?
            "has an empty or non-finite value, or a row of another length" :
        time[0] < 0 || time.some((t, k) => t < time[k - 1]) ? "time must begin at 0 or later and must not decrease" :
        steps < 1 || steps > DATA.constants.MOST_ROWS || Math.abs(steps - Math.round(steps)) > 1e-6 ?
            `the end at ${general(stop, 6)} s must be a whole number of steps of ${STEP} s, ` +
            `${DATA.constants.MOST_ROWS} at most` : "";
    if (problem) throw new Error(`${title}: ${problem}`.replace(/[^\x20-\uFFFF]/g, "?").slice(0, 400));
    const points = times(stop), command = column("fin_command");
    return {title, time: points, points: time.map((t, k) => [t, command[k]]),
        columns: Object.fromEntries(inputs.map(name => [name, resampled(points, time, column(name))]))};
}

/** A column interpolated at points of time: at a jump the later value, before and after the rows constant. */
function resampled(points, time, column) {
    let after = 0;
    return points.map(point => {
        while (after < time.length && time[after] <= point * (1 + 1e-12)) ++after;
        const low = Math.max(after - 1, 0), high = Math.min(after, time.length - 1), span = time[high] - time[low];
        const share = span > 0 ? Math.min(Math.max((point - time[low]) / span, 0), 1) : 0;
        return column[low] + share * (column[high] - column[low]);
    });
}
