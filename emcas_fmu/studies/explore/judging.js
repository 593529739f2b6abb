/* Long computations for a setting, which a worker runs: the tests of the requirements, and frequency responses. */

/** The function `respond` that measure.js calls, for a setting with changed parameters. */
function responding(actuator, setting, changes) {
    return (excitation, names) => {
        try {
            return actuator.run(setting, excitation, names, changes);
        } catch {
            return null;
        }
    };
}

/** Amplitude [rad] and load [N.m] of each frequency response: of the requirements, and of a chosen sine or sweep. */
function sinesOf({kind, fields: {amplitude, torque}}) {
    const required = DATA.tests.filter(test => test.kind === "sine").map(test => [test.amplitude, 0]);
    const known = required.some(([size, load]) => size === amplitude && load === torque);
    return ["sine", "sweep"].includes(kind) && amplitude && !known ? [...required, [amplitude, torque]] : required;
}

const COMPUTATIONS = {
    /** The figures of each test of the requirements, by case. */
    measured: (actuator, setting) => DATA.tests.map(test => Object.fromEntries(test.cases.map(name => {
        const changes = DATA.cases[name];
        return [name, test.kind === "linear" ? [loopOf(actuator, setting, changes) ?? {}] :
            measure(test, setting, responding(actuator, setting, changes))];
    }))),

    /** The frequency responses, each with its amplitude [rad] and load [N.m]. */
    responses: (actuator, setting) => sinesOf(setting).map(sine =>
        [sine, frequencyResponse(...sine, responding(actuator, setting, DATA.at_start))]),
};

/** Runs in the worker: receives the name of a computation and the values of a setting, and posts [result], or
    [null, message] if the computation fails. */
function serve(loaded) {
    onmessage = async ({data: [name, values]}) => {
        try {
            postMessage([COMPUTATIONS[name](await loaded, new Setting(values))]);
        } catch (error) {
            postMessage([null, error.message]);
        }
    };
}

/** Runs computations in a worker with the page's data, actuator and program. */
class Background {
    constructor([data, code, program]) {
        const source = `const DATA = ${data};${program};serve(Actuator.load("${code.trim()}"));`;
        this.source = URL.createObjectURL(new Blob([source], {type: "text/javascript"}));
    }

    /** Ends a running computation, whose result is then never posted. */
    end() {
        this.worker?.terminate();
    }

    /** Starts one of COMPUTATIONS in place of an earlier one; promises its result, or rejects with an Error. */
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
