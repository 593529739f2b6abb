/* The actuator: its generated C as WebAssembly, limits and rules of its parameters, and runs. All values are in SI. */

/** A number as text in C's format %.{digits}g. */
function general(x, digits) {
    if (!Number.isFinite(x)) return Number.isNaN(x) ? "nan" : x > 0 ? "inf" : "-inf";
    if (x === 0) return "0";
    const small = Math.abs(x.toPrecision(digits)) < 1e-4;
    const [mantissa, exponent] = (small ? x.toExponential(digits - 1) : x.toPrecision(digits)).split("e");
    const short = mantissa.includes(".") ? mantissa.replace(/\.?0+$/, "") : mantissa;
    return exponent ? `${short}e${exponent.replace(/\d+/, power => power.padStart(2, "0"))}` : short;
}

/** A message with its values in place of formats such as %.6g and %s, as in rules.py. */
function formatted(message, values) {
    let next = 0;
    return message.replace(/%(?:\.(\d+))?([gs%])/g, (_, digits, kind) =>
        kind === "%" ? "%" : kind === "s" ? values[next++] : general(values[next++], Number(digits ?? 6)));
}

const MOST_ARGUMENTS = 256; // limit of the numbers of arguments and of results of a function

class Actuator {
    static async load(base64) {
        const bytes = Uint8Array.from(atob(base64), character => character.charCodeAt(0));
        const code = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
        const {instance} = await WebAssembly.instantiate(await new Response(code).arrayBuffer());
        return new Actuator(instance.exports);
    }

    constructor(code) {
        this.code = code;
        code._initialize();
        this.top = code.__heap_base.value;
        this.parameters = this.reserve(DATA.parameters.length);
        this.numbers = this.reserve(DATA.most_numbers);
        this.result = this.reserve(1);
        this.constants = this.reserve(code.at_rest_prepare?.(this.parameters, 0) ?? 0);
        this.point = this.reserve(MOST_ARGUMENTS);
        this.values = this.reserve(MOST_ARGUMENTS);
    }

    /** Reserves memory for `count` doubles; returns its address. */
    reserve(count) {
        const address = (this.top + 15) & ~15;
        this.top = address + 8 * count;
        const missing = this.top - this.code.memory.buffer.byteLength;
        if (missing > 0) this.code.memory.grow(Math.ceil(missing / 65536));
        return address;
    }

    /** The addresses of memory for as many doubles as each of `counts`; the next call reuses this memory. */
    scratch(...counts) {
        const {top} = this, addresses = counts.map(count => this.reserve(count));
        this.top = top;
        return addresses;
    }

    doubles(address, count) {
        return new Float64Array(this.code.memory.buffer, address, count);
    }

    put(values) {
        this.doubles(this.parameters, DATA.parameters.length).set(DATA.parameters.map(p => Number(values[p.name])));
    }

    /** Messages, as in rules.py, for parameters outside their limits; if all are within, for broken rules. */
    problems(values) {
        const outside = DATA.parameters.filter(p => p.kind !== "Boolean").flatMap(p => {
            const value = values[p.name], messages = DATA.limits;
            return !Number.isFinite(value) ? [formatted(messages.not_finite, [p.name, value])] :
                value < p.minimum ? [formatted(messages.below, [p.name, value, p.minimum])] :
                value > p.maximum ? [formatted(messages.above, [p.name, value, p.maximum])] : [];
        });
        return outside.length ? outside : this.broken(values, false);
    }

    /** Messages of the rules that parameters within their limits break: errors or, with `warnings`, warnings. */
    broken(values, warnings) {
        this.put(values);
        return DATA.rules.flatMap((rule, i) => {
            if (rule.warning !== warnings || !this.code.rule_broken(i, this.parameters, this.numbers)) return [];
            return [formatted(rule.message, [...this.doubles(this.numbers, DATA.most_numbers)].slice(1))];
        });
    }

    /** The largest steady motor torques [N.m] at motor speeds [rad/s], at a supply [V]. */
    limitTorques(values, supply, speeds) {
        this.put(values);
        const count = speeds.length, [from, to] = this.scratch(count, count);
        this.doubles(from, count).set(speeds);
        this.code.limit_torques(this.parameters, supply, from, count, to);
        return this.doubles(to, count).slice();
    }

    /** The schedule, the start values, and plant and controllers as functions of arrays (bench/linear/equations.py).
        With `hold` a function reuses the conditions of the previous call. */
    equations(values, supply) {
        this.put(values);
        this.code.at_rest_prepare(this.parameters, this.constants);
        const {states, kept, sampled} = DATA.linear;
        const compiled = (name, count) => (x, hold = false) => {
            this.doubles(this.point, MOST_ARGUMENTS).set([supply, ...x]);
            this.code[name](this.parameters, this.constants, this.point, hold, this.values);
            return this.doubles(this.values, count).slice();
        };
        this.code.scheduled(this.parameters, this.values);
        const schedule = this.doubles(this.values, 9).slice();
        return {schedule, start: compiled("at_rest_start", states + kept)([]),
            plant: compiled("at_rest_plant", states + 1),
            controllers: compiled("at_rest_controllers", kept + 2 + sampled)};
    }

    /** Simulates a setting with changed parameters. Returns the excitation and the outputs `names` as columns. Throws
        an Error if the run does not reach its end. */
    run(setting, excitation, names = DATA.outputs, changes = {}) {
        const inputs = setting.inputs(excitation), rows = excitation.time.length;
        this.put({...setting.parameters, ...changes});
        const [ins, outs] = this.scratch(rows * DATA.inputs.length, rows * DATA.outputs.length);
        const column = (table, index) => this.doubles(table + 8 * rows * index, rows);
        DATA.inputs.forEach(({name}, index) => {
            if (typeof inputs[name] === "object") column(ins, index).set(inputs[name]);
            else column(ins, index).fill(Number(inputs[name]));
        });
        const reached = this.code.simulate_rows(this.parameters, rows, STEP, ins, outs, this.result);
        const reason = new Int32Array(this.code.memory.buffer, this.result, 1)[0];
        if (reached < rows) throw new Error(`at ${general(reached * STEP, 6)} s: ${DATA.reasons[reason]}`);
        return {excitation, outputs: Object.fromEntries(names.map(name =>
            [name, column(outs, DATA.outputs.indexOf(name)).slice()]))};
    }
}
