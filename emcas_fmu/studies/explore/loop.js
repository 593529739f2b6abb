"use strict";
/* The open loop of the cases: Bode and Nichols plots with the margins. */

/** The plots of the open loop, and the poles of the closed one. */
class LoopPlots {
    /** `change` moves a pole, as for Poles. */
    constructor(box, change) {
        const bode = {x: "frequency [Hz]", log: true, shared: false};
        this.gain = new Plot("Gain of the open loop", {...bode, y: "[dB]"});
        this.phase = new Plot("Phase of the open loop", {...bode, y: "[°]", turns: "y"});
        this.nichols = new Plot("Nichols plot", {x: "phase [°]", y: "gain [dB]", shared: false,
            turns: "x", legend: false, height: 235});
        this.poles = new Poles(change);
        this.all = [this.gain, this.phase, this.nichols, this.poles.plot];
        box.append(...this.all.map(plot => plot.figure));
    }

    draw(cases, summary) {
        const loops = cases.filter(([, {loop}]) => loop).map(([letter, {loop}]) => ({...loop,
            label: cases.length > 1 ? `loop ${letter}` : "loop", stroke: COLORS[letter === "A" ? 1 : 0],
            dash: letter === "A" ? [7, 4] : undefined}));
        for (const plot of this.all) plot.figure.hidden = !loops.length;
        const words = cases.map(([letter, {loop}]) => (cases.length > 1 ? `${letter}: ` : "") + marginsInWords(loop));
        summary.textContent = words.join(". ");
        if (!loops.length) return;
        for (const [plot, part, level] of [[this.gain, "gain", 0], [this.phase, "phase", -180]]) {
            plot.over = u => {
                rule(u, "y", level, part === "gain" ? "0 dB" : "−180°");
                for (const {stroke, margins} of loops) {
                    for (const point of margins) mark(u, point.frequency, point[part], stroke());
                }
            };
            plot.draw(loops.map(({frequency, [part]: y, stroke, label, dash}) => ({label, stroke, dash, x: frequency,
                y: Array.from(y, value => part === "phase" && value < -360 ? null : value)})));
        }
        this.drawNichols(loops);
        this.poles.draw(loops.map(loop => ({...loop, poles: upperPoles(loop)})));
        for (const plot of [this.gain, this.phase, this.nichols]) plot.describe(words.join(". "));
    }

    /** Draws gain over phase near the point at which the closed loop oscillates, with it. */
    drawNichols(loops) {
        this.nichols.over = u => {
            rule(u, "x", -180, "−180°");
            rule(u, "y", 0, "0 dB");
            for (const {stroke, dash, phase, gain, margins} of loops) {
                trajectory(u, {x: phase, y: gain, stroke, dash});
                for (const point of margins) mark(u, point.phase, point.gain, stroke());
            }
        };
        this.nichols.draw([{label: "", x: [-360, 0], y: [-30, 40], stroke: gray, width: 0}]);
    }

    redraw() {
        for (const plot of this.all) plot.redraw();
    }
}

function marginsInWords(loop) {
    if (!loop) return "the actuator does not rest at 0, so that its loop has no margins";
    if (!loop.stable) return "unstable when closed, so that it has no margins";
    if (loop.idle) return "the fin does not react to the reference";
    const {gain_margin: gain, phase_margin: phase, delay_margin: delay, phaseCrossover, gainCrossover} = loop;
    const limited = (value, unit, at) => Number.isFinite(value) ?
        withUnit(value, unit) + (at ? ` at ${withUnit(at, "Hz")}` : "") : "without limit";
    return `gain margin ${limited(gain, "dB", phaseCrossover)}, phase margin ` +
        `${limited(degrees(phase), "°", gainCrossover)}, delay margin ${limited(1e3 * delay, "ms")}`;
}
