/* Plots by uPlot in the page's colours, and shapes that are painted on them. */

const gray = () => css("--gray");
const COLORS = Array.from({length: 6}, (_, k) => () => css(`--curve-${k}`));

const PHASE_TICKS = {incrs: [15, 45, 90]}; // distances of the ticks [°]

function axis(label, size) {
    const values = (_, at) => at.map(x => x === null ? "" : general(x, 6).replace("-", "−"));
    return {...AXIS, label, size, labelSize: 18, values};
}

/** Paints a line across the plot at a value of the scale x or y, with a text at its end; `below` a line at y. */
function rule(u, scale, value, text, below = false) {
    paint(u, (ctx, x, y, frame) => {
        const {left, top, width, height} = frame, level = scale === "y", at = level ? y(value) : x(value);
        if (level ? at < top || at > top + height : at < left || at > left + width) return;
        pen(ctx, gray(), 1, [2, 3]);
        across(ctx, scale, at, frame);
        Object.assign(ctx, {font: SMALL(), textAlign: "right"});
        const [right, down] = level ? [left + width - 4, at + (below ? 12 : -4)] : [at - 4, top + height - 6];
        ctx.fillText(text, right, down);
    });
}

/** Fills the path that `paints` adds, within the plot's frame, with the colour `name` of the page. */
function filled(u, name, paints) {
    paint(u, (ctx, ...of) => {
        paints(ctx, ...of);
        ctx.fillStyle = css(name);
        ctx.fill();
    }, true);
}

/** Shades the intervals of time in which a flag is set. */
function shade(u, time, flag) {
    filled(u, "--shade", (ctx, x, y, {top, height}) => {
        for (let k = 0; k < flag.length; ++k) {
            if (flag[k] <= 0.5) continue;
            const first = x(time[k]);
            while (flag[k + 1] > 0.5) ++k;
            ctx.rect(first, top, Math.max(x(time[k]) - first, devicePixelRatio), height);
        }
    });
}

/** Shades a band around a command that reaches `width` to each side. */
function band(u, time, command, width) {
    filled(u, "--band", (ctx, x, y) => {
        time.forEach((t, k) => ctx.lineTo(x(t), y(command[k] + width)));
        for (let k = time.length - 1; k >= 0; --k) ctx.lineTo(x(time[k]), y(command[k] - width));
    });
}

/** Paints a ring at a point. */
function mark(u, at, level, stroke) {
    if (!Number.isFinite(at) || !Number.isFinite(level)) return;
    paint(u, (ctx, x, y) => {
        pen(ctx, stroke, 2);
        ctx.fillStyle = css("--back");
        ctx.arc(x(at), y(level), 4 * devicePixelRatio, 0, 2 * Math.PI);
        ctx.fill();
        ctx.stroke();
    });
}

/** Paints a curve through points in their order, with a dot at the last one. */
function trajectory(u, {x: xs, y: ys, stroke, dash}) {
    paint(u, (ctx, x, y) => {
        pen(ctx, stroke(), 1.6, dash);
        xs.forEach((at, k) => ctx.lineTo(x(at), y(ys[k])));
        ctx.stroke();
        ctx.beginPath();
        ctx.arc(x(xs.at(-1)), y(ys.at(-1)), 3 * devicePixelRatio, 0, 2 * Math.PI);
        ctx.fill();
    }, true);
}

/** Paints the line of a damping ratio, and its value, in a plane of poles of the given `size`. */
function ray(u, damping, size) {
    paint(u, (ctx, x, y) => {
        const [a, b] = [-damping * 0.95 * size, Math.sqrt(1 - damping * damping) * 0.95 * size];
        pen(ctx, gray(), 0.5, [2, 3]);
        Object.assign(ctx, {font: SMALL(), textAlign: "right"});
        ctx.moveTo(x(0), y(0));
        ctx.lineTo(x(a), y(b));
        ctx.stroke();
        ctx.fillText(shownNumber(damping), x(a) - 3, y(b) - 3);
    }, true);
}

function cross(u, [real, imaginary], stroke) {
    paint(u, (ctx, x, y) => {
        const [a, b, size] = [x(real), y(imaginary), 4 * devicePixelRatio];
        pen(ctx, stroke, 2);
        for (const side of [-1, 1]) {
            ctx.moveTo(a - size, b - side * size);
            ctx.lineTo(a + size, b + side * size);
        }
        ctx.stroke();
    }, true);
}

/* The plots by their boxes, and the observer that renders plots in or near the window. */
const PLOTS = new Map(), IN_VIEW = new IntersectionObserver(entries => {
    for (const {target, isIntersecting} of entries) PLOTS.get(target).shown(isIntersecting);
}, {rootMargin: "50%"});

/** A plot as wide as its figure in the page. */
class Plot {
    constructor(title, look) {
        this.box = element("div", {class: "plot", role: "img"});
        this.figure = element("figure", {}, element("figcaption", {}, title), this.box);
        this.title = title;
        this.look = {log: false, height: 190, shared: true, legend: true, ...look};
        this.ticks = [];  // [position, name] of the ticks along y, if they have names
        this.reach = [Infinity, -Infinity];  // smallest and largest y of painted shapes
        this.under = this.over = this.sketch = this.pointed = () => undefined;
        this.box.style.minHeight = `${this.look.height + (this.look.legend ? 26 : 0)}px`;  // before it is drawn
        new ResizeObserver(() => {
            const width = this.box.clientWidth;
            if (this.uplot && width) this.uplot.setSize({width, height: this.look.height});
        }).observe(this.box);
        IN_VIEW.observe(this.box);
        PLOTS.set(this.box, this);
    }

    /** The chart of uPlot, with the latest curves. */
    get chart() {
        const curves = this.waiting;
        this.waiting = null;
        if (curves) this.render(curves);
        return this.uplot;
    }

    shown(inView) {
        this.inView = inView;
        if (inView && this.waiting) this.draw(this.waiting);
    }

    /** Plots curves {label, x, y, stroke, dash, width, step}, whose x may differ. A plot out of view is rendered later,
        since a dozen plots would slow the page. */
    draw(curves) {
        this.waiting = curves;
        if (this.inView) this.chart;
    }

    render(curves) {
        const xs = [...new Set(curves.map(curve => curve.x))], by = x => curves.filter(curve => curve.x === x);
        const ordered = xs.flatMap(by), names = ordered.map(({label}) => label).join("\n");
        const data = uPlot.join(xs.map(x => [x, ...by(x).map(({y}) => y)]));
        if (names === this.names) {
            this.uplot.setData(data);
            return;
        }
        this.uplot?.destroy();
        this.names = names;
        this.uplot = new uPlot(this.options(ordered), data, this.box);
    }

    options(curves) {
        const {x, y, log, height, shared, turns, legend} = this.look, range = (_, low, high) => {
            const least = Math.min(low, this.reach[0]), most = Math.max(high, this.reach[1]);
            const [first] = this.ticks[0] ?? [];
            return this.ticks.length ? [first - 0.3, first + this.ticks.length - 0.2] :
                least === most ? [least - 1, most + 1] : uPlot.rangeNum(least, most, 0.1, true);
        };
        const number = (_, v) => shownNumber(v ?? null);
        const dash = ({dash: [on] = []} = {}) => !on ? "solid" : on > 2 ? "dashed" : "dotted";
        return {
            width: this.box.clientWidth || 300, height,
            legend: {show: legend, markers: {width: 2, dash: (_, k) => dash(curves[k - 1])}},
            cursor: {sync: shared ? {key: "time"} : undefined, points: {size: 5}, drag: {x: true, y: false}},
            scales: {x: {time: false, distr: log ? 3 : 1, range: (_, least, most) => [least, most]},
                y: {range}},
            axes: [{...axis(x, 26), ...(turns === "x" ? PHASE_TICKS : {})}, this.ticks.length ?
                {...axis("", 110), labelSize: 0, splits: () => this.ticks.map(([at]) => at),
                    values: () => this.ticks.map(([, name]) => name)} :
                {...axis(y, 58), ...(turns === "y" ? PHASE_TICKS : {})}],
            series: [{label: x.replace(/ .*/, ""), value: number},
                ...curves.map(({label, stroke, dash, step, width = 1.6, value = number}) => ({
                    label, stroke, dash, width, value, spanGaps: true, points: {show: false},
                    paths: step ? uPlot.paths.stepped({align: 1}) : undefined}))],
            hooks: {init: [u => u.root.classList.add("idle")],
                setCursor: [({root, cursor: {idx = null}, data: [time]}) => {
                    root.classList.toggle("idle", idx === null);
                    if (idx !== null) this.pointed(time[idx]);
                }],
                drawAxes: [u => this.under(u)], draw: [u => this.over(u), u => this.sketch(u)]},
        };
    }

    /** The values along x and y under a pointer. */
    at({clientX, clientY}) {
        const {left, top} = this.chart.over.getBoundingClientRect();
        return [this.chart.posToVal(clientX - left, "x"), this.chart.posToVal(clientY - top, "y")];
    }

    /** Moves the cursor of all plots over time to a time [s]. */
    point(time) {
        this.chart.setCursor({left: this.chart.valToPos(time, "x"), top: 10}, false, true);
    }

    redraw() {
        this.chart?.redraw(false, true);
    }

    describe(text) {
        this.box.setAttribute("aria-label", `${this.title}: ${text}`);
    }
}

/** Two plots over frequency: gain [dB] and phase [°]. */
const bodePlots = (titles, ofPhase = {}) => titles.map((title, k) => new Plot(title, {
    x: "frequency [Hz]", y: k ? "[°]" : "[dB]", log: true, shared: false, ...(k ? ofPhase : {})}));

/** Plots responses {label, stroke, dash, frequency, gain, phase, marks: [{frequency, gain, phase}]}, a line at the
    level [value, text] of each plot, and a `required` bandwidth [Hz]. `text` describes both plots in words. */
function drawBode(plots, levels, responses, text, required) {
    for (const [k, part] of ["gain", "phase"].entries()) {
        const plot = plots[k], [level, name] = levels[k], hasLimit = required && part === "gain";
        plot.under = u => hasLimit && filled(u, "--forbidden", (ctx, x, y, {left, top, height}) =>
            ctx.rect(left, y(level), x(required) - left, top + height - y(level)));
        plot.over = u => {
            rule(u, "y", level, name);
            if (hasLimit) rule(u, "x", required, `required ${shownNumber(required)} Hz`);
            for (const {stroke, marks} of responses) {
                for (const {frequency, [part]: at} of marks) mark(u, frequency, at, stroke());
            }
        };
        if (responses.length) plot.draw(responses.map(({frequency: x, [part]: y, ...look}) => ({...look, x, y})));
        plot.figure.hidden = !responses.length;
        plot.describe(text);
    }
}

/** A number as text with four digits, or a dash for none. */
function shownNumber(x) {
    if (x === null || Number.isNaN(x)) return "–";
    if (!Number.isFinite(x)) return "not reached";
    return (Math.abs(x) >= 9999.5 ? x.toFixed(0) : general(x, 4)).replace("-", "−");
}
