"use strict";
/* Runs of the actuator in a worker, beside the page. */

/** The worker's program: answers each message, a number and the arguments of Actuator.run, in turn. */
function answering(loaded) {
    onmessage = async ({data: [number, ...run]}) => {
        const actuator = await loaded;
        try {
            postMessage([number, actuator.run(...run)]);
        } catch {
            postMessage([number, null]);
        }
    };
}

class Runs {
    constructor() {
        const [data, code, program] = ["data", "actuator", "program"].map(id => $(id).textContent);
        const source = `const DATA = ${data};${program};(${answering})(Actuator.load("${code.trim()}"));`;
        this.worker = new Worker(URL.createObjectURL(new Blob([source], {type: "text/javascript"})));
        this.waiting = new Map();
        this.count = 0;
        this.worker.onmessage = ({data: [number, outputs]}) => {
            this.waiting.get(number)(outputs);
            this.waiting.delete(number);
        };
    }

    /** Promises the outputs of Actuator.run, or null if the run does not reach its end. */
    run(...run) {
        this.worker.postMessage([++this.count, ...run]);
        return new Promise(resolve => this.waiting.set(this.count, resolve));
    }
}
