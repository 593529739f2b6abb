/* Settings, which contain the values that differ from the page's initial ones, and their links and files. SI. */

const CONSTANT_INPUTS = DATA.inputs.filter(v => !["fin_command", "aero_torque"].includes(v.name));
const CONTROLS = new Map([...DATA.fields, ...CONSTANT_INPUTS, ...DATA.parameters].map(v => [v.name, v]));

const MOST_BYTES = 50e6; // largest size of a CSV file, which the browser reads whole
const MOST_PACKED = 48e3; // largest compressed size [bytes] of a CSV file in a link; browsers limit the length of links

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

    /** The setting with another value. A new kind of excitation has its usual fields; only the torque is kept. */
    with(name, value) {
        const values = {...this.values, [name]: value};
        if (name === "excitation.kind") {
            for (const {name: field} of DATA.fields) if (field !== "excitation.torque") delete values[field];
        } else if (value === this.default(name)) {
            delete values[name];
        }
        return new Setting(values, this.file);
    }

    /** The setting with only the values of a preset, and with the present command and load. */
    withPreset({values}) {
        const excitation = Object.entries(this.values).filter(([name]) => name.startsWith("excitation."));
        return new Setting({...Object.fromEntries(excitation), ...values}, this.file);
    }

    /** The preset with exactly the values of the setting, apart from the excitation; undefined if there is none. */
    get preset() {
        const set = Object.entries(this.values).filter(([name]) => !name.startsWith("excitation."));
        return DATA.presets.find(({values}) =>
            set.length === Object.keys(values).length && set.every(([name, value]) => values[name] === value));
    }

    get parameters() {
        return Object.fromEntries(DATA.parameters.map(({name}) => [name, this.get(name)]));
    }

    get fields() {
        return Object.fromEntries(DATA.kinds[this.kind].fields.map(field => [field, this.get(`excitation.${field}`)]));
    }

    /** Messages for values that are not numbers. */
    get unreadable() {
        const texts = [...CONTROLS.values()].filter(({name}) => typeof this.get(name) === "string");
        return texts.map(({name, shown: [unit]}) =>
            `${name}: '${this.get(name)}' is not a number${unit && `; the unit is ${unit}`}`);
    }

    /** Messages for fields of the excitation, and constant inputs, that are outside their limits. */
    get problems() {
        const fields = Object.keys(this.fields).map(field => CONTROLS.get(`excitation.${field}`));
        return [...fields, ...CONSTANT_INPUTS].filter(({kind}) => kind === "Real").flatMap(control => {
            const {name, minimum, maximum, shown: [unit, factor]} = control, value = this.get(name);
            const [x, least, most] = [value, minimum, maximum].map(each => general(each / factor, 6));
            return value >= minimum && value <= maximum && Number.isFinite(value) ? [] :
                [`${name} = ${x} ${unit} must be within ${least} .. ${most} ${unit}`];
        });
    }

    /** The excitation. Throws an Error for a sweep that does not rise or a missing CSV file. */
    excite() {
        const {kind, fields} = this;
        return kind === "csv" ? fileExcitation(this.file, fields.torque) : excitationOf(kind, fields);
    }

    /** All inputs, as columns or constants. */
    inputs(excitation) {
        const constants = CONSTANT_INPUTS.map(({name}) => [name, this.get(name)]);
        return {fin_command: 0, aero_torque: 0, ...Object.fromEntries(constants), ...excitation.columns};
    }

    toString() {
        return new URLSearchParams(Object.entries(this.values)).toString();
    }

    /** The setting in the text of a link, and the names that are unknown or have no valid value. */
    static parse(text) {
        const values = {}, unknown = [];
        for (const [name, value] of new URLSearchParams(text)) {
            const control = CONTROLS.get(name), isFlag = control?.kind === "Boolean";
            const isValid = isFlag ? ["true", "false"].includes(value) : control && Number.isFinite(Number(value));
            if (name === "excitation.kind" && value in DATA.kinds) values[name] = value;
            else if (isValid) values[name] = isFlag ? value === "true" : Number(value);
            else unknown.push(name);
        }
        return [new Setting(values), unknown];
    }
}

/** The name and the text of a CSV file as compressed text for a link; empty if it is too long. */
async function packed(title, text) {
    const stream = new Blob([`${title}\n${text}`]).stream().pipeThrough(new CompressionStream("deflate-raw"));
    const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
    if (bytes.length > MOST_PACKED) return "";
    return btoa(String.fromCharCode(...bytes)).replaceAll("+", "-").replaceAll("/", "_");
}

/** The CSV file in a link. Throws an Error if it is not readable or too large. */
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

/** Warnings of a command beyond its limit, as Response.warnings in response.py; only a file's may be in degrees. */
function clippingWarnings(setting, {columns: {fin_command: command}}) {
    const {message, rounding, in_degrees: inDegrees, like_degrees: likeDegrees} = DATA.clipping;
    const limit = setting.get("command.limit"), most = command ? magnitude(command) : 0;
    if (most <= limit * (1 + rounding)) return [];
    const mayBeDegrees = setting.kind === "csv" && most > likeDegrees;
    return [formatted(message, [most, degrees(most), degrees(limit)]) + (mayBeDegrees ? inDegrees : "")];
}

/** The text of a parameter file for the option -p, with all values that differ from the defaults. */
function parameterFile(setting) {
    const entries = [...DATA.parameters, ...CONSTANT_INPUTS.filter(v => v.key)];
    const differing = new Set(entries.filter(v => setting.get(v.name) !== v.shipped).map(v => v.name));
    /* If a file sets one of two parameters that must be equal, the other follows: write both. */
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

/** The text of a CSV file for `emcas simulate` with columns by name, in SI with all digits. */
function csv(columns) {
    const rows = Array.from(columns.time, (_, k) => Object.values(columns).map(column => column[k]).join(","));
    return [Object.keys(columns).join(","), ...rows, ""].join("\n");
}
