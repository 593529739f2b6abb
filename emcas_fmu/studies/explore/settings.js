"use strict";
/* A setting: the values that differ from the page's own, with links and files that hold one. SI throughout. */

const EXCITATION = [
    {name: "excitation.amplitude", title: "Amplitude of the command", unit: "rad", shown: DATA.units.rad,
        minimum: -Math.PI, maximum: Math.PI, range: [-DATA.command_limit, DATA.command_limit]},
    {name: "excitation.frequency", title: "Frequency", unit: "Hz", minimum: 0.05, maximum: 100, range: [0.5, 30],
        value: 5},
    {name: "excitation.low", title: "Lowest frequency", unit: "Hz", minimum: 0.05, maximum: 100,
        value: DATA.constants.SWEEP[0]},
    {name: "excitation.high", title: "Highest frequency", unit: "Hz", minimum: 0.1, maximum: 200,
        value: DATA.constants.SWEEP[1]},
    {name: "excitation.load", title: "Load torque on the hinge", unit: "N.m", minimum: -1e6, maximum: 1e6,
        range: [-2 * DATA.load, 2 * DATA.load], value: DATA.inputs.find(({name}) => name === "aero_torque").value},
    {name: "excitation.duration", title: "Duration", unit: "s", minimum: 0.01, maximum: 60},
].map(control => ({kind: "Real", shown: [control.unit, 1], description: "", ...control}));
/* Command and load are the excitation's. */
const HELD = DATA.inputs.filter(v => !["fin_command", "aero_torque"].includes(v.name));
const CONTROLS = new Map([...EXCITATION, ...HELD, ...DATA.parameters].map(control => [control.name, control]));

class Setting {
    constructor(values = {}, file = null) {
        this.values = values;
        this.file = file;
    }

    get shape() {
        return this.values["excitation.shape"] ?? "step";
    }

    default(name) {
        const field = name.replace("excitation.", "");
        return field !== name && field in SHAPES[this.shape] ? SHAPES[this.shape][field] : CONTROLS.get(name).value;
    }

    get(name) {
        return this.values[name] ?? this.default(name);
    }

    /** The same with another value; another shape begins with its own fields, and keeps the load. */
    with(name, value) {
        const values = {...this.values, [name]: value};
        if (name === "excitation.shape") {
            for (const {name: field} of EXCITATION) if (field !== "excitation.load") delete values[field];
        } else if (value === this.default(name)) {
            delete values[name];
        }
        return new Setting(values, this.file);
    }

    withFile(file) {
        return new Setting({...this.values, "excitation.shape": "csv"}, file);
    }

    get parameters() {
        return Object.fromEntries(DATA.parameters.map(({name}) => [name, this.get(name)]));
    }

    /** What was written where a number belongs, in words. */
    get unreadable() {
        const written = [...CONTROLS.values()].filter(({name}) => typeof this.get(name) === "string");
        return written.map(({name, shown: [unit]}) =>
            `${name}: '${this.get(name)}' is not a number${unit && unit !== "1" ? `; the unit is ${unit}` : ""}`);
    }

    /** What is wrong with the fields of the excitation and the inputs held, in words. */
    get problems() {
        const numbers = [...EXCITATION, ...HELD].filter(({kind}) => kind === "Real");
        return numbers.flatMap(({name, minimum, maximum, shown: [unit, factor]}) => {
            const value = this.get(name), of = [value, minimum, maximum].map(x => general(x / factor, 6));
            return value >= minimum && value <= maximum && Number.isFinite(value) ? [] :
                [`${name} = ${of[0]} ${unit} must be within ${of[1]} .. ${of[2]} ${unit}`];
        });
    }

    /** The rows of inputs of the shape. Throws an Error. */
    excite() {
        const fields = EXCITATION.map(({name}) => [name.replace("excitation.", ""), this.get(name)]);
        return SHAPES[this.shape].build({...Object.fromEntries(fields), file: this.file});
    }

    /** Every input: what is excited, and what is held. */
    inputs(excitation) {
        const held = HELD.map(({name}) => [name, this.get(name)]);
        return {fin_command: 0, aero_torque: 0, ...Object.fromEntries(held), ...excitation.columns};
    }

    toString() {
        return new URLSearchParams(Object.entries(this.values)).toString();
    }

    /** The setting of a link's text, and the names in it that the page does not have or cannot read. */
    static parse(text) {
        const values = {}, unknown = [];
        for (const [name, written] of new URLSearchParams(text)) {
            const control = CONTROLS.get(name), flag = control?.kind === "Boolean";
            const sound = flag ? ["true", "false"].includes(written) : control && Number.isFinite(Number(written));
            if (name === "excitation.shape" && written in SHAPES) values[name] = written;
            else if (sound) values[name] = flag ? written === "true" : Number(written);
            else unknown.push(name);
        }
        return [new Setting(values), unknown];
    }
}

/** What is worth a look in the commands given, as Response.warnings of response.py; a file alone may be in degrees. */
function clipped(setting, {columns: {fin_command: command}}) {
    const {message, rounding, in_degrees: inDegrees, like_degrees: likeDegrees} = DATA.clipping;
    const limit = setting.get("command.limit"), most = command ? largest(command.map(Math.abs)) : 0;
    if (most <= limit * (1 + rounding)) return [];
    const file = setting.shape === "csv" && most > likeDegrees;
    return [formatted(message, [most, degrees(most), degrees(limit)]) + (file ? inDegrees : "")];
}

/** A parameter file of all that differs from the shipped defaults, for -p. */
function parameterFile(setting) {
    const entries = [...DATA.parameters, ...HELD.filter(v => v.key)];
    const differing = new Set(entries.filter(v => setting.get(v.name) !== v.shipped).map(v => v.name));
    /* Of two that are equal in SI units a file with one would move the other. */
    for (const pair of DATA.equal.filter(pair => pair.some(name => differing.has(name)))) {
        pair.forEach(name => differing.add(name));
    }
    const lines = entries.filter(v => differing.has(v.name)).map(v => {
        const unit = v.kind === "Boolean" ? "" : `, unit = ${JSON.stringify(v.unit)}`;
        return `${JSON.stringify(v.key ?? v.name)} = { value = ${setting.get(v.name)}${unit} }`;
    });
    return [`# Parameters of the actuator ${DATA.model} that differ from its defaults, from a page of ${DATA.tool}.`,
        `# emcas simulate --model ${DATA.model} --input inputs.csv -p parameters.toml`, ...lines, ""].join("\n");
}

/** Columns by name as a CSV file that `emcas simulate` reads, or writes: SI, every digit. */
function csv(columns) {
    const names = Object.keys(columns);
    const rows = Array.from(columns.time, (_, k) => names.map(name => columns[name][k]).join(","));
    return [names.join(","), ...rows, ""].join("\n");
}

/** The inputs that are given: those excited, and those held at another value than their start. */
function givenInputs(setting, excitation) {
    const held = HELD.filter(({name}) => setting.get(name) !== CONTROLS.get(name).start);
    const constant = held.map(({name}) => [name, excitation.time.map(() => Number(setting.get(name)))]);
    return {time: excitation.time, ...Object.fromEntries(constant), ...excitation.columns};
}
