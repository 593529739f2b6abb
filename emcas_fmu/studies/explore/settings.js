"use strict";
/* A setting: the values that differ from the page's initial ones; links and files of a setting. SI throughout. */

/* The inputs that are constant. */
const HELD = DATA.inputs.filter(v => !["fin_command", "aero_torque"].includes(v.name));
const CONTROLS = new Map([...DATA.fields, ...HELD, ...DATA.parameters].map(control => [control.name, control]));

const MOST_BYTES = 50e6; // largest CSV file, which the browser reads whole
const MOST_PACKED = 48e3; // bytes of the largest compressed CSV file in a link; browsers limit the length of links

class Setting {
    constructor(values = {}, file = null) {
        this.values = values;
        this.file = file;
    }

    get kind() {
        return this.values["excitation.kind"] ?? "step";
    }

    default(name) {
        return DATA.kinds[this.kind].usual[name.replace("excitation.", "")] ?? CONTROLS.get(name).value;
    }

    get(name) {
        return this.values[name] ?? this.default(name);
    }

    /** The setting with another value. A new kind of excitation starts from its usual fields, and keeps the torque. */
    with(name, value) {
        const values = {...this.values, [name]: value};
        if (name === "excitation.kind") {
            for (const {name: field} of DATA.fields) if (field !== "excitation.torque") delete values[field];
        } else if (value === this.default(name)) {
            delete values[name];
        }
        return new Setting(values, this.file);
    }

    withFile(file) {
        return new Setting({...this.values, "excitation.kind": "csv"}, file);
    }

    /** The setting with the values of a preset only, and the same command and load. */
    withPreset({values}) {
        const excitation = Object.entries(this.values).filter(([name]) => name.startsWith("excitation."));
        return new Setting({...Object.fromEntries(excitation), ...values}, this.file);
    }

    /** The preset whose values are set; undefined if there is none. */
    get preset() {
        const set = Object.entries(this.values).filter(([name]) => !name.startsWith("excitation."));
        return DATA.presets.find(({values}) =>
            set.length === Object.keys(values).length && set.every(([name, value]) => values[name] === value));
    }

    get parameters() {
        return Object.fromEntries(DATA.parameters.map(({name}) => [name, this.get(name)]));
    }

    /** The fields of the excitation. */
    get fields() {
        return Object.fromEntries(DATA.kinds[this.kind].fields.map(field => [field, this.get(`excitation.${field}`)]));
    }

    /** Messages for texts that are not numbers. */
    get unreadable() {
        const written = [...CONTROLS.values()].filter(({name}) => typeof this.get(name) === "string");
        return written.map(({name, shown: [unit]}) =>
            `${name}: '${this.get(name)}' is not a number${unit && `; the unit is ${unit}`}`);
    }

    /** Messages for fields of the excitation, and constant inputs, that are outside their limits. */
    get problems() {
        const fields = Object.keys(this.fields).map(field => CONTROLS.get(`excitation.${field}`));
        return [...fields, ...HELD].filter(({kind}) => kind === "Real").flatMap(control => {
            const {name, minimum, maximum, shown: [unit, factor]} = control, value = this.get(name);
            const [x, least, most] = [value, minimum, maximum].map(each => general(each / factor, 6));
            return value >= minimum && value <= maximum && Number.isFinite(value) ? [] :
                [`${name} = ${x} ${unit} must be within ${least} .. ${most} ${unit}`];
        });
    }

    /** The excitation. Throws an Error. */
    excite() {
        return this.kind === "csv" ? ofFile(this.file, this.fields.torque) : excited(this.kind, this.fields);
    }

    /** All inputs, as columns or constants. */
    inputs(excitation) {
        const held = HELD.map(({name}) => [name, this.get(name)]);
        return {fin_command: 0, aero_torque: 0, ...Object.fromEntries(held), ...excitation.columns};
    }

    toString() {
        return new URLSearchParams(Object.entries(this.values)).toString();
    }

    /** The setting in a link's text, and the names in the text that are unknown or have no valid value. */
    static parse(text) {
        const values = {}, unknown = [];
        for (const [name, written] of new URLSearchParams(text)) {
            const control = CONTROLS.get(name), flag = control?.kind === "Boolean";
            const sound = flag ? ["true", "false"].includes(written) : control && Number.isFinite(Number(written));
            if (name === "excitation.kind" && written in DATA.kinds) values[name] = written;
            else if (sound) values[name] = flag ? written === "true" : Number(written);
            else unknown.push(name);
        }
        return [new Setting(values), unknown];
    }
}

/** A CSV file and its name as compressed text for a link; empty if it is too long. */
async function packed(title, text) {
    const stream = new Blob([`${title}\n${text}`]).stream().pipeThrough(new CompressionStream("deflate-raw"));
    const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
    if (bytes.length > MOST_PACKED) return "";
    return btoa(String.fromCharCode(...bytes)).replaceAll("+", "-").replaceAll("/", "_");
}

/** The CSV file in a link. Throws an Error. */
async function unpacked(text) {
    const bytes = Uint8Array.from(atob(text.replaceAll("-", "+").replaceAll("_", "/")), c => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
    const reader = stream.pipeThrough(new TextDecoderStream()).getReader();
    let whole = "";
    for (let read = await reader.read(); !read.done; read = await reader.read()) {
        whole += read.value;
        if (whole.length > MOST_BYTES) throw new Error("it is too large");
    }
    const [title] = whole.split("\n", 1), rows = whole.slice(title.length + 1);
    return {...fromCsv(rows, title), text: rows, packed: text};
}

/** Warnings of commands beyond the limit, as Response.warnings in response.py; only a file could be in degrees. */
function clipped(setting, {columns: {fin_command: command}}) {
    const {message, rounding, in_degrees: inDegrees, like_degrees: likeDegrees} = DATA.clipping;
    const limit = setting.get("command.limit"), most = command ? magnitude(command) : 0;
    if (most <= limit * (1 + rounding)) return [];
    const file = setting.kind === "csv" && most > likeDegrees;
    return [formatted(message, [most, degrees(most), degrees(limit)]) + (file ? inDegrees : "")];
}

/** The text of a parameter file for -p, with all values that differ from the defaults. */
function parameterFile(setting) {
    const entries = [...DATA.parameters, ...HELD.filter(v => v.key)];
    const differing = new Set(entries.filter(v => setting.get(v.name) !== v.shipped).map(v => v.name));
    /* Of two parameters that are equal in SI, a file with one alone would change the other as well. */
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

/** The text of a CSV file of `emcas simulate` from columns by name: SI, all digits. */
function csv(columns) {
    const rows = Array.from(columns.time, (_, k) => Object.values(columns).map(column => column[k]).join(","));
    return [Object.keys(columns).join(","), ...rows, ""].join("\n");
}

/** The inputs for a file: the excitation, and constant inputs that differ from their start values. */
function inputColumns(setting, {time, columns}) {
    const held = HELD.filter(({name, start}) => setting.get(name) !== start);
    const constant = held.map(({name}) => [name, time.map(() => Number(setting.get(name)))]);
    return {time, ...Object.fromEntries(constant), ...columns};
}
