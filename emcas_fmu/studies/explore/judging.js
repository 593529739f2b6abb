"use strict";
/* Long computations for a setting, in a worker: the tests of the requirements, and frequency responses. */

/** The function `respond` of measure.js for a setting with changed parameters. */
function responding(actuator, setting, changes) {
    return (excitation, names) => {
        try {
            return actuator.run(setting, excitation, names, changes);
        } catch {
            return null;
        }
    };
}

/** Amplitude [rad] and load [N.m] of each frequency response: of the requirements, and of a sine or sweep if chosen. */
function sinesOf({kind, fields: {amplitude, torque}}) {
    const required = DATA.tests.filter(test => test.kind === "sine").map(test => [test.amplitude, 0]);
    const known = required.some(([size, load]) => size === amplitude && load === torque);
    return ["sine", "sweep"].includes(kind) && amplitude && !known ? [...required, [amplitude, torque]] : required;
}

const LONG = {
    /** The figures of all tests of the requirements, by case. */
    measured: (actuator, setting) => DATA.tests.map(test => Object.fromEntries(test.cases.map(name => {
        const changes = DATA.cases[name];
        return [name, test.kind === "linear" ? [loopOf(actuator, setting, changes) ?? {}] :
            measure(test, setting, responding(actuator, setting, changes))];
    }))),

    /** The frequency responses, each with its amplitude [rad] and load [N.m]. */
    responses: (actuator, setting) => sinesOf(setting).map(sine =>
        [sine, frequencyResponse(...sine, responding(actuator, setting, DATA.at_start))]),
};

/** The worker's program: it receives the name of a computation and a setting's values, and posts [result], or
    [null, message] if the computation fails. */
function answering(loaded) {
    onmessage = async ({data: [name, values]}) => {
        try {
            postMessage([LONG[name](await loaded, new Setting(values))]);
        } catch (error) {
            postMessage([null, error.message]);
        }
    };
}

/** A worker with the page's data, actuator and program. */
class Worked {
    constructor([data, code, program]) {
        const source = `const DATA = ${data};${program};answering(Actuator.load("${code.trim()}"));`;
        this.source = URL.createObjectURL(new Blob([source], {type: "text/javascript"}));
    }

    /** Ends a computation without an answer. */
    end() {
        this.worker?.terminate();
    }

    /** Promises the result of a computation of LONG, or rejects with an Error; ends an earlier computation. */
    ask(name, setting) {
        this.end();
        this.worker = new Worker(this.source);
        this.worker.postMessage([name, setting.values]);
        return new Promise((resolve, reject) => {
            this.worker.onmessage = ({data: [answer, problem]}) =>
                problem ? reject(new Error(problem)) : resolve(answer);
            this.worker.onerror = ({message}) => reject(new Error(message || "the browser does not start the worker"));
        });
    }
}
