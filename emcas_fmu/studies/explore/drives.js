"use strict";
/* What moves the fin in the sketch of the mechanism: each drive has shapes, and shows a row of the outputs. */

const ARM = 55; // of the lever, in the drawing
const WHEEL = 38; // radius of the worm wheel, in the drawing

/** An element of a drawing. */
const shape = (tag, attributes, ...children) =>
    set(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, ...children);

/** A motor at (x, y) with a spoke at its angle. */
class Motor {
    constructor(x, y) {
        this.spoke = shape("path", {class: "lever", d: "M0 0 V-11"});
        const circle = shape("circle", {class: "nut", r: 13});
        this.shapes = [shape("g", {transform: `translate(${x} ${y})`}, circle, this.spoke)];
    }

    show({motor_angle: angle}) {
        set(this.spoke, {transform: `rotate(${degrees(angle)})`});
    }
}

/** A lever whose end a nut or a rod moves along a line; positive angles turn the end to the right. */
class Lever {
    constructor(position, moved) {
        Object.assign(this, {position, moved});
        this.lever = shape("path", {class: "lever"});
        this.shapes = [shape("path", {class: "thin", d: `M-72 ${ARM} H72`}), this.lever, moved];
    }

    show(outputs, {"kinematics.moment_arm": arm, "kinematics.initial_angle": initial}) {
        set(this.moved, {transform: `translate(${ARM * (outputs[this.position] / arm + Math.tan(initial))} 0)`});
        set(this.lever, {d: `M0 0 L${ARM * Math.tan(outputs.fin_angle + initial)} ${ARM}`});
    }
}

/** A screw, and the motor that turns it if it has an angle. */
class Screw {
    constructor() {
        this.lever = new Lever("nut_position", shape("path", {class: "nut", d: `M-9 ${ARM - 8} h18 v16 h-18 Z`}));
        this.motor = DATA.outputs.includes("motor_angle") && new Motor(-88, ARM);
        this.shapes = [...this.lever.shapes, ...this.motor ? this.motor.shapes : []];
    }

    show(outputs, parameters) {
        this.lever.show(outputs, parameters);
        if (this.motor) this.motor.show(outputs);
    }
}

/** A worm below its wheel on the fin's hinge; its threads move by the motor's angle, the wheel by the fin's. */
class Worm {
    constructor() {
        this.wheel = shape("path", {class: "nut wheel"});
        this.threads = shape("path", {class: "worm"});
        this.motor = new Motor(-74, WHEEL + 14);
        const [top, middle, bottom] = [3, 14, 25].map(y => WHEEL + y);
        const worm = shape("path", {class: "nut", d: `M-61 ${middle} H-46 V${top} H46 V${bottom} H-46 V${middle}`});
        this.shapes = [worm, this.threads, this.wheel, shape("circle", {class: "nut", r: WHEEL - 5}),
            ...this.motor.shapes];
    }

    show(outputs, {"worm.teeth": teeth, "worm.starts": starts}) {
        const turn = 2 * Math.PI / teeth, pitch = WHEEL * turn;
        const spokes = Array.from({length: teeth}, (_, k) => {
            const angle = k * turn + outputs.fin_angle, [x, y] = [Math.sin(angle), Math.cos(angle)];
            return `M${(WHEEL - 5) * x} ${(WHEEL - 5) * y} L${WHEEL * x} ${WHEEL * y}`;
        });
        set(this.wheel, {d: spokes.join(" ")});
        /* Where a tooth is at the bottom, a gap between threads is. */
        const moved = (WHEEL * outputs.motor_angle * starts / teeth / pitch + 0.5) % 1, half = Math.ceil(46 / pitch);
        const threads = Array.from({length: 2 * half + 1}, (_, k) => pitch * (k - half + moved)).filter(
            x => x > -42 && x < 46).map(x => `M${x} ${WHEEL + 3} L${x - 4} ${WHEEL + 25}`);
        set(this.threads, {d: threads.join(" ")});
        this.motor.show(outputs);
    }
}

/** A cylinder at a lever, its chambers as dark as their pressures, with a valve's spool or the direction of a pump. */
class Cylinder {
    constructor() {
        const rod = shape("g", {class: "piston"}, shape("path", {d: `M-78 ${ARM} H0`, class: "lever"}),
            shape("path", {class: "nut", d: `M-81 ${ARM - 11} h6 v22 h-6 Z`}),
            shape("circle", {class: "nut", cy: ARM, r: 4}));
        this.lever = new Lever("piston_position", rod);
        this.chambers = [0, 1].map(() => shape("rect", {class: "pressure", y: ARM - 11, height: 22}));
        this.valve = DATA.outputs.includes("valve_position");
        this.control = this.valve ? shape("path", {class: "lever", d: "M-12 0 H12 M-7 -4 V4 M7 -4 V4"}) :
            shape("path", {class: "lever"});
        const box = this.valve ? shape("rect", {class: "nut", x: -23, y: -7, width: 46, height: 14}) :
            shape("circle", {class: "nut", r: 11});
        const [left, right] = this.valve ? [-101, -55] : [-89, -67];
        const lines = shape("path", {class: "pipe",
            d: `M-104 ${ARM - 11} V14 H${left} M-52 ${ARM - 11} V14 H${right}`});
        this.shapes = [...this.chambers, shape("rect", {x: -109, y: ARM - 11, width: 62, height: 22}), lines,
            shape("g", {transform: "translate(-78 14)"}, box, this.control), ...this.lever.shapes.slice(1)];
    }

    show(outputs, parameters, highest) {
        this.lever.show(outputs, parameters);
        const {"kinematics.moment_arm": arm, "kinematics.initial_angle": initial} = parameters;
        const piston = -78 + ARM * (outputs.piston_position / arm + Math.tan(initial));
        [[-109, piston], [piston, -47]].forEach(([x, end], k) => set(this.chambers[k], {
            x, width: Math.max(end - x, 0), "fill-opacity": 0.7 * outputs[`pressure_${k + 1}`] / highest}));
        const pumped = Math.sign(outputs.motor_speed);
        if (this.valve) set(this.control, {transform: `translate(${10 * outputs.valve_position} 0)`});
        else set(this.control, {d: pumped ? `M${-9 * pumped} 0 l${7 * pumped} -5 v10 Z` : ""});
    }
}

/** The drive of the page's actuator; null if nothing is known of it but the fin. */
function driveOf() {
    const has = name => DATA.outputs.includes(name), named = name => DATA.parameters.some(p => p.name === name);
    return has("nut_position") ? new Screw() : has("piston_position") ? new Cylinder() :
        named("worm.teeth") ? new Worm() : has("motor_angle") ? new Motor(-88, 0) : null;
}
