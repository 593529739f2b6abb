"use strict";
/* A command that is drawn by hand in the plot of the fin angle, or written as points: a CSV file like any other. */

const DRAWN = "drawn command";

/** The points of a drawn command, time [s] and angle [rad], from its CSV file. */
function pointsOf(file) {
    return file?.title === DRAWN ? file.text.trim().split("\n").slice(1).map(line => line.split(",").map(Number)) : [];
}

/** The points with those of a stroke in their place; without points before it the command is 0, after it it is held. */
function drawnOver(points, stroke, end) {
    const [[first], [last, level]] = [stroke[0], stroke.at(-1)];
    const [times, angles] = [0, 1].map(k => points.map(point => point[k]));
    const joint = time => [time, points.length ? sampled([time], times, angles)[0] : 0];
    const before = [...points.length ? [] : [[0, 0]], ...points.filter(([time]) => time < first), joint(first)];
    const after = points.filter(([time]) => time > last);
    return [...before, ...stroke, ...after.length ? [joint(last), ...after] : last < end ? [[end, level]] : []];
}

class Drawing {
    /** Calls `done(text)` with a CSV file when a stroke over a plot ends, or when points are written. */
    constructor(plot, done) {
        Object.assign(this, {plot, done, stroke: null, button: $("draw"), field: $("points")});
        this.button.addEventListener("click", () => this.turn(!this.on));
        this.field.addEventListener("change", () => done(this.written));
        for (const [event, action] of Object.entries({
            pointerdown: at => this.begin(at), pointermove: at => this.move(at), pointerup: () => this.end(),
            pointercancel: () => this.end(), mousedown: () => undefined})) {
            plot.box.addEventListener(event, at => {
                if (!this.on || !(this.stroke || at.target.closest(".u-over"))) return;
                at.stopPropagation();  // a drag is no zoom
                action(at);
            }, true);
        }
        plot.sketch = u => this.stroke && trajectory(u, {x: this.stroke.map(([time]) => time),
            y: this.stroke.map(([, angle]) => degrees(angle)), stroke: COLORS[1]});
    }

    get on() {
        return this.button.getAttribute("aria-pressed") === "true";
    }

    /** Begins or ends drawing. While it is on, the plot reaches to the largest command. */
    turn(on) {
        this.button.setAttribute("aria-pressed", String(on));
        this.plot.box.classList.toggle("drawing", on);
        this.plot.reach = on ? [-degrees(this.limit), degrees(this.limit)] : [Infinity, -Infinity];
        this.plot.chart.setData(this.plot.chart.data);
        this.show(this.setting);
    }

    /** Shows the points of a setting. */
    show(setting) {
        this.setting = setting;
        const points = pointsOf(setting.kind === "csv" ? setting.file : null);
        $("points-row").hidden = !this.on && !points.length;
        if (document.activeElement === this.field) return;
        this.field.value = points.map(([time, angle]) => `${time}, ${general(degrees(angle), 9)}`).join("\n");
    }

    get limit() {
        return this.setting.get("command.limit");
    }

    /** Time [s] and command [rad] under a pointer, rounded to a step and to 0.01°. */
    under({clientX, clientY}) {
        const {chart} = this.plot, {left, top} = chart.over.getBoundingClientRect(), end = chart.data[0].at(-1);
        const time = Math.min(Math.max(chart.posToVal(clientX - left, "x"), 0), end), limit = degrees(this.limit);
        const angle = Math.min(Math.max(chart.posToVal(clientY - top, "y"), -limit), limit);
        return [Math.round(time / STEP) / Math.round(1 / STEP), Math.round(100 * angle) / 100 * Math.PI / 180];
    }

    begin(at) {
        this.plot.box.setPointerCapture(at.pointerId);
        this.stroke = [this.under(at)];
    }

    /** Adds a point; going back takes points away. */
    move(at) {
        if (!this.stroke) return;
        const point = this.under(at);
        while (this.stroke.at(-1)?.[0] >= point[0]) this.stroke.pop();
        this.stroke.push(point);
        this.plot.redraw();
    }

    end() {
        const {stroke, plot: {chart}} = this;
        this.stroke = null;
        if (!stroke) return;
        const kept = pointsOf(this.setting.kind === "csv" ? this.setting.file : null);
        const end = Math.round(chart.data[0].at(-1) / STEP) / Math.round(1 / STEP);
        this.done(csvOf(drawnOver(kept, stroke, end)));
    }

    /** The CSV file of the points that are written: a line each, time [s] and angle [°]. */
    get written() {
        const lines = this.field.value.split("\n").filter(line => line.trim());
        return csvOf(lines.map(line => {
            const [time, angle = NaN, ...more] = line.replaceAll("−", "-").trim().split(/[\s,;]+/).map(Number);
            return more.length ? [NaN, NaN] : [time, angle * Math.PI / 180];
        }));
    }
}

function csvOf(points) {
    return ["time,fin_command", ...points.map(point => point.join(",")), ""].join("\n");
}
