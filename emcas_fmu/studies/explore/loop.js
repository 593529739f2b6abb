/* The loops of the cases: Bode and Nichols plots of the open loop with its margins, and poles of the closed loop. */

class LoopPlots {
    /** `change` is that of Poles. */
    constructor(box, change) {
        this.bode = bodePlots(["Gain of the open loop", "Phase of the open loop"], {turns: "y"});
        this.nichols = new Plot("Nichols plot", {x: "phase [°]", y: "gain [dB]", shared: false,
            turns: "x", legend: false, height: 235});
        this.poles = new Poles(change);
        this.all = [...this.bode, this.nichols, this.poles.plot];
        box.append(...this.all.map(plot => plot.figure));
    }

    draw(cases, summary) {
        const loops = cases.filter(([, {loop}]) => loop).map(([letter, {loop}]) =>
            ({...loop, label: caseLabel(cases, letter, "loop"), ...lookOf(letter)}));
        for (const plot of this.all) plot.figure.hidden = !loops.length;
        const words = caseTexts(cases, ({loop}) => loopText(loop));
        summary.textContent = words;
        if (!loops.length) return;
        drawBode(this.bode, [[0, "0 dB"], [-180, "−180°"]], loops.map(loop =>
            ({...loop, phase: loop.phase.map(value => value < -360 ? null : value)})), words);
        this.poles.draw(loops.map(loop => ({...loop, poles: upperPoles(loop)})));
        this.nichols.describe(words);
        /* The plot shows the surroundings of the critical point, −180° and 0 dB. */
        this.nichols.over = u => {
            rule(u, "x", -180, "−180°");
            rule(u, "y", 0, "0 dB");
            for (const {stroke, dash, phase, gain, marks} of loops) {
                trajectory(u, {x: phase, y: gain, stroke, dash});
                for (const point of marks) mark(u, point.phase, point.gain, stroke());
            }
        };
        this.nichols.draw([{label: "", x: [-360, 0], y: [-30, 40], stroke: gray, width: 0}]);
    }
}

function loopText(loop) {
    if (!loop) return "the actuator cannot rest at 0, so its loop has no margins";
    if (!loop.stable) return "unstable when closed, so the loop has no margins";
    if (loop.idle) return "the fin does not react to the reference";
    const {gain_margin: gain, phase_margin: phase, delay_margin: delay, phaseCrossover, gainCrossover} = loop;
    const limited = (value, unit, at) => Number.isFinite(value) ?
        withUnit(value, unit) + (at ? ` at ${withUnit(at, "Hz")}` : "") : "unlimited";
    return `gain margin ${limited(gain, "dB", phaseCrossover)}, phase margin ` +
        `${limited(degrees(phase), "°", gainCrossover)}, delay margin ${limited(1e3 * delay, "ms")}`;
}
