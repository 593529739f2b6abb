/* A sketch of the mechanism at one time of the response: the fin, its command, and its drive. */

const PLAYED = 5; // s, duration to which shorter responses are slowed down; longer ones are played in real time
const REDUCED_MOTION = window.matchMedia("(prefers-reduced-motion: reduce)");

class Mechanism {
    /** Calls `moved(time)` when the user moves the slider, and while the response is played; the time is in s. */
    constructor(moved) {
        this.moved = moved;
        this.time = Infinity;
        this.fin = shape("path", {class: "fin", d: "M-9 0 L-5 -88 L5 -88 L9 0 Z"});
        this.command = shape("path", {class: "thin", d: "M0 0 V-94"});
        this.drive = drive();
        this.picture = shape("svg", {viewBox: "-110 -100 220 178", role: "img"},
            ...this.drive.flatMap(part => part.shapes), this.command, this.fin, shape("circle", {class: "nut", r: 4}));
        this.slider = element("input", {type: "range", "aria-label": "Time at which the mechanism is shown", min: 0});
        this.button = element("button", {type: "button"}, "Play");
        this.text = element("span", {class: "quiet"});
        this.figure = element("figure", {class: "mechanism"}, element("figcaption", {}, "Mechanism"), this.picture,
            element("div", {class: "row"}, this.button, this.slider, this.text));
        this.slider.addEventListener("input", () => {
            this.stop();
            this.set(Number(this.slider.value));
        });
        this.button.addEventListener("click", () => this.playing ? this.stop() : this.play());
        const quiet = () => {
            this.stop();
            this.button.hidden = REDUCED_MOTION.matches;
        };
        REDUCED_MOTION.addEventListener("change", quiet);
        quiet();
    }

    /** Shows another response, at the time at which the last one was shown. */
    showResponse({excitation, outputs}, parameters) {
        Object.assign(this, {excitation, outputs, parameters});
        this.highest = largest(["pressure_1", "pressure_2"].map(name => largest(outputs[name] ?? [1])));
        this.slider.max = this.end;
        this.slider.step = STEP;
        this.show(this.time);
    }

    get end() {
        return this.excitation.time.at(-1);
    }

    set(time) {
        this.show(time);
        this.moved(time);
    }

    show(time) {
        const {outputs, parameters, excitation: {columns: {fin_command: command}}} = this;
        this.time = time;
        const k = Math.round(Math.min(time, this.end) / STEP), fin = outputs.fin_angle[k];
        /* A positive angle turns the lever's end to the right, hence counterclockwise; SVG counts clockwise. */
        set(this.fin, {transform: `rotate(${-degrees(fin)})`});
        set(this.command, {transform: `rotate(${-degrees(command?.[k] ?? 0)})`});
        const row = Object.fromEntries(Object.entries(outputs).map(([name, column]) => [name, column[k]]));
        for (const part of this.drive) part.show(row, parameters, this.highest);
        const shown = `${shownNumber(k * STEP)} s`, angle = `fin angle ${withUnit(degrees(fin), "°")}`;
        this.slider.value = k * STEP;
        this.slider.setAttribute("aria-valuetext", `${shown}, ${angle}`);
        this.picture.setAttribute("aria-label", `The mechanism at ${shown}: ${angle}`);
        this.text.textContent = shown;
    }

    play() {
        const rate = Math.min(1, this.end / PLAYED), from = this.time < this.end ? this.time : 0;
        let begin;
        const next = now => {
            begin ??= now;
            const time = from + (now - begin) / 1000 * rate;
            this.set(Math.min(time, this.end));
            if (time < this.end) this.playing = requestAnimationFrame(next);
            else this.stop();
        };
        this.button.textContent = "Pause";
        this.playing = requestAnimationFrame(next);
    }

    stop() {
        cancelAnimationFrame(this.playing);
        this.playing = null;
        this.button.textContent = "Play";
    }
}
