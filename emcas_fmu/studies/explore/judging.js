"use strict";
/* Long computations of a setting, in a worker: the tests of the requirements, and frequency responses. */

const BUSY = 16; // ms after which a long computation looks whether it is still needed

/** The function `respond` of measure.js for a setting with changes; once not `needed`, it never answers. */
function responding(actuator, setting, changes, needed = () => true) {
    let due = 0;
    return async (excitation, names = DATA.outputs) => {
        if (performance.now() > due) {
            await new Promise(resolve => setTimeout(resolve));
            due = performance.now() + BUSY;
        }
        if (!needed()) return new Promise(() => undefined);
        try {
            return {excitation, outputs: actuator.run({...setting.parameters, ...changes}, setting.inputs(excitation),
                excitation.time.length, STEP, names)};
        } catch {
            return null;
        }
    };
}

/** Amplitude [rad] and load [N.m] of the frequency responses: of requirements, and of a sine or sweep that is set. */
function sinesOf({kind, fields: {amplitude, torque}}) {
    const required = DATA.tests.filter(test => test.kind === "sine").map(test => [test.amplitude, 0]);
    const known = required.some(([size, load]) => size === amplitude && load === torque);
    return ["sine", "sweep"].includes(kind) && amplitude && !known ? [...required, [amplitude, torque]] : required;
}

const LONG = {
    /** The figures of all tests of the requirements, by case. */
    async measured(actuator, setting, needed) {
        const measured = [];
        for (const test of DATA.tests) {
            const figures = {};
            for (const name of test.cases) {
                const changes = DATA.cases[name];
                figures[name] = test.kind === "linear" ? [loopOf(actuator, setting, changes) ?? {}] :
                    await measure(test, setting, responding(actuator, setting, changes, needed));
            }
            measured.push(figures);
        }
        return measured;
    },

    /** The frequency responses, each with its amplitude [rad] and load [N.m]. */
    async responses(actuator, setting, needed) {
        const respond = responding(actuator, setting, DATA.at_start, needed), responses = [];
        for (const sine of sinesOf(setting)) responses.push([sine, await frequencyResponse(...sine, respond)]);
        return responses;
    },
};

/** The worker's program: answers a message, its number with the name of a computation and a setting's values, by the
    number with the result, or with what went wrong. */
function answering(loaded) {
    let latest;
    onmessage = async ({data: [number, name, values]}) => {
        latest = number;
        try {
            postMessage([number, await LONG[name](await loaded, new Setting(values), () => number === latest)]);
        } catch (error) {
            postMessage([number, null, error.message]);
        }
    };
}

/** A worker with the page's data, actuator and program. */
class Worked {
    constructor([data, code, program]) {
        const source = `const DATA = ${data};${program};answering(Actuator.load("${code.trim()}"));`;
        this.worker = new Worker(URL.createObjectURL(new Blob([source], {type: "text/javascript"})));
        this.worker.onmessage = ({data: [number, answer, problem]}) => {
            if (number === this.count) this.done(answer, problem);
        };
        this.worker.onerror = ({message}) => {
            this.broken = message || "the browser does not start it";
            this.done?.(null, this.broken);
        };
        this.count = 0;
    }

    /** Promises the answer to a computation of LONG, or throws an Error; a later one ends it without. */
    ask(name, setting) {
        this.worker.postMessage([++this.count, name, setting.values]);
        return new Promise((resolve, reject) => {
            this.done = (answer, problem) => problem ? reject(new Error(problem)) : resolve(answer);
            if (this.broken) this.done(null, this.broken);
        });
    }
}
