/* The drive in the sketch of the mechanism: parts, each with `shapes`, and with `show(row, parameters, highest)`, which
 * moves them to a row of outputs; `highest` is the highest pressure [Pa] of the response. */

const ARM = 55; // length of the lever, in units of the sketch
const WHEEL = 38; // radius of the worm wheel, in units of the sketch

const shape = (tag, attributes, ...children) =>
    set(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, ...children);

/** A motor at (x, y) with a spoke that turns by the motor angle. */
function motor(x, y) {
    const circle = shape("circle", {class: "nut", r: 13}), spoke = shape("path", {class: "lever", d: "M0 0 V-11"});
    return {shapes: [shape("g", {transform: `translate(${x} ${y})`}, circle, spoke)],
        show: ({motor_angle: angle}) => set(spoke, {transform: `rotate(${degrees(angle)})`})};
}

/** The position of a lever's end in the sketch, positive to the right, at a position [m] of the nut or rod. */
const along = (position, {"kinematics.moment_arm": arm, "kinematics.initial_angle": initial}) =>
    ARM * (position / arm + Math.tan(initial));

/** A lever with the nut or rod `mover`, placed by the output `position`, in front of the shapes `behind`. */
function lever(position, mover, ...behind) {
    const arm = shape("path", {class: "lever"});
    return {shapes: [...behind, arm, mover], show(outputs, parameters) {
        set(mover, {transform: `translate(${along(outputs[position], parameters)} 0)`});
        set(arm, {d: `M0 0 L${ARM * Math.tan(outputs.fin_angle + parameters["kinematics.initial_angle"])} ${ARM}`});
    }};
}

/** A worm below its wheel on the fin's hinge; the motor angle moves the threads, the fin angle the wheel. */
function worm() {
    const wheel = shape("path", {class: "nut wheel"}), threads = shape("path", {class: "worm"});
    const [top, middle, bottom] = [3, 14, 25].map(y => WHEEL + y);
    const body = shape("path", {class: "nut", d: `M-61 ${middle} H-46 V${top} H46 V${bottom} H-46 V${middle}`});
    const disc = shape("circle", {class: "nut", r: WHEEL - 5});
    return {shapes: [body, threads, wheel, disc], show(outputs, {"worm.teeth": teeth, "worm.starts": starts}) {
        const turn = 2 * Math.PI / teeth, pitch = WHEEL * turn;
        const spokes = Array.from({length: teeth}, (_, k) => {
            const angle = k * turn + outputs.fin_angle, [x, y] = [Math.sin(angle), Math.cos(angle)];
            return `M${(WHEEL - 5) * x} ${(WHEEL - 5) * y} L${WHEEL * x} ${WHEEL * y}`;
        });
        set(wheel, {d: spokes.join(" ")});
        /* The offset 0.5 puts the lowest tooth between two threads. */
        const offset = (WHEEL * outputs.motor_angle * starts / teeth / pitch + 0.5) % 1, half = Math.ceil(46 / pitch);
        const lines = Array.from({length: 2 * half + 1}, (_, k) => pitch * (k - half + offset)).filter(
            x => x > -42 && x < 46).map(x => `M${x} ${WHEEL + 3} L${x - 4} ${WHEEL + 25}`);
        set(threads, {d: lines.join(" ")});
    }};
}

/** A cylinder, whose chambers are darker at higher pressure, with the spool of a valve or the direction of a pump. */
function cylinder() {
    const chambers = [0, 1].map(() => shape("rect", {class: "pressure", y: ARM - 11, height: 22}));
    const valve = DATA.outputs.includes("valve_position"), [left, right] = valve ? [-101, -55] : [-89, -67];
    const control = shape("path", {class: "lever", d: valve ? "M-12 0 H12 M-7 -4 V4 M7 -4 V4" : ""});
    const box = valve ? shape("rect", {class: "nut", x: -23, y: -7, width: 46, height: 14}) :
        shape("circle", {class: "nut", r: 11});
    const pipes = shape("path", {class: "pipe", d: `M-104 ${ARM - 11} V14 H${left} M-52 ${ARM - 11} V14 H${right}`});
    return {shapes: [...chambers, shape("rect", {x: -109, y: ARM - 11, width: 62, height: 22}), pipes,
        shape("g", {transform: "translate(-78 14)"}, box, control)], show(outputs, parameters, highest) {
        const piston = -78 + along(outputs.piston_position, parameters), pumped = Math.sign(outputs.motor_speed);
        [[-109, piston], [piston, -47]].forEach(([x, end], k) => set(chambers[k], {
            x, width: Math.max(end - x, 0), "fill-opacity": 0.7 * outputs[`pressure_${k + 1}`] / highest}));
        if (valve) set(control, {transform: `translate(${10 * outputs.valve_position} 0)`});
        else set(control, {d: pumped ? `M${-9 * pumped} 0 l${7 * pumped} -5 v10 Z` : ""});
    }};
}

/** The parts of the drive of the page's actuator; none if the outputs contain no motion except the fin's. */
function drive() {
    const has = name => DATA.outputs.includes(name), turned = y => has("motor_angle") ? [motor(-88, y)] : [];
    const path = (name, d) => shape("path", {class: name, d});
    if (has("nut_position")) {
        const nut = path("nut", `M-9 ${ARM - 8} h18 v16 h-18 Z`);
        return [lever("nut_position", nut, path("thin", `M-72 ${ARM} H72`)), ...turned(ARM)];
    }
    if (has("piston_position")) {
        const rod = shape("g", {class: "piston"}, path("lever", `M-78 ${ARM} H0`),
            path("nut", `M-81 ${ARM - 11} h6 v22 h-6 Z`), shape("circle", {class: "nut", cy: ARM, r: 4}));
        return [cylinder(), lever("piston_position", rod)];
    }
    return CONTROLS.has("worm.teeth") ? [worm(), motor(-74, WHEEL + 14)] : turned(0);
}
