"use strict";
/* Eigenvalues of a real matrix (Golub & Van Loan, "Matrix Computations", sections 7.4 and 7.5). */

/** A matrix scaled by powers of 2 so that its rows are as large as its columns, which leaves its eigenvalues. */
function balanced(a) {
    const whole = a.map(row => Float64Array.from(row));
    const sum = values => values.reduce((s, x) => s + Math.abs(x), 0);
    for (let again = true; again;) {
        again = false;
        for (const k of a.keys()) {
            const own = Math.abs(whole[k][k]), rows = sum(whole[k]) - own;
            const columns = sum(whole.map(row => row[k])) - own;
            const factor = rows && columns ? 2 ** Math.round(Math.log2(rows / columns) / 2) : 1;
            if (rows / factor + columns * factor >= 0.95 * (rows + columns)) continue;
            again = true;
            whole.forEach(row => { row[k] *= factor; });
            whole[k].forEach((x, j) => { whole[k][j] = x / factor; });
        }
    }
    return whole;
}

/** A similar matrix without elements below the first subdiagonal, by elimination; of the argument. */
function hessenberg(h) {
    const n = h.length;
    for (let m = 1; m < n - 1; ++m) {
        let p = m;
        for (let i = m + 1; i < n; ++i) if (Math.abs(h[i][m - 1]) > Math.abs(h[p][m - 1])) p = i;
        if (h[p][m - 1] === 0) continue;
        [h[p], h[m]] = [h[m], h[p]];
        for (const row of h) [row[p], row[m]] = [row[m], row[p]];
        for (let i = m + 1; i < n; ++i) {
            const y = h[i][m - 1] / h[m][m - 1];
            for (let j = 0; j < n; ++j) h[i][j] -= y * h[m][j];
            for (let j = 0; j < n; ++j) h[j][m] += y * h[j][i];
        }
    }
    return h;
}

/** The complex square root. */
function root([x, y]) {
    const size = Math.hypot(x, y), real = Math.sqrt((size + Math.abs(x)) / 2), other = real && y / (2 * real);
    return x >= 0 ? [real, other] : [Math.abs(other), y < 0 ? -real : real];
}

/** The eigenvalue of [[a, b], [c, d]] next to d; of complex numbers. */
function shiftOf([ar, ai], [br, bi], [cr, ci], [dr, di]) {
    const [x, y] = [(ar - dr) / 2, (ai - di) / 2];
    const [re, im] = root([x * x - y * y + br * cr - bi * ci, 2 * x * y + br * ci + bi * cr]);
    const sign = x * re + y * im > 0 ? -1 : 1;
    return [dr + x + sign * re, di + y + sign * im];
}

/** Turns two elements of a complex matrix by c and s, with the sign of their imaginary parts. */
function turned(re, im, [i, j], [k, l], cr, ci, sr, si, sign) {
    const pr = re[i][j], pi = sign * im[i][j], qr = re[k][l], qi = sign * im[k][l];
    re[i][j] = cr * pr - ci * pi + sr * qr - si * qi;
    im[i][j] = sign * (cr * pi + ci * pr + sr * qi + si * qr);
    re[k][l] = cr * qr + ci * qi - sr * pr - si * pi;
    im[k][l] = sign * (cr * qi - ci * qr - sr * pi + si * pr);
}

/** The eigenvalues, as [real, imaginary], by complex QR steps with shifts. */
function eigenvalues(a) {
    const re = hessenberg(balanced(a)), n = a.length, im = zeros(n, n), at = (i, j) => [re[i][j], im[i][j]];
    const size = (i, j) => Math.abs(re[i][j]) + Math.abs(im[i][j]);
    for (let end = n - 1, steps = 0; end > 0 && steps < 3000; ++steps) {
        let first = end;
        while (first > 0 && size(first, first - 1) > 1e-16 * (size(first, first) + size(first - 1, first - 1))) --first;
        if (first === end) {
            --end;
            continue;
        }
        const [x, y] = steps % 11 === 10 ? [re[end][end] + size(end, end - 1), 0] :
            shiftOf(at(end - 1, end - 1), at(end - 1, end), at(end, end - 1), at(end, end));
        for (let k = first; k <= end; ++k) [re[k][k], im[k][k]] = [re[k][k] - x, im[k][k] - y];
        const turns = [];
        for (let k = first; k < end; ++k) {  // rows by the conjugate of a rotation, then columns by the rotation
            const whole = Math.hypot(...at(k, k), ...at(k + 1, k)) || 1;
            turns.push([...at(k, k), ...at(k + 1, k)].map(value => value / whole));
            for (let j = k; j <= end; ++j) turned(re, im, [k, j], [k + 1, j], ...turns.at(-1), -1);
        }
        turns.forEach((turn, t) => {
            const k = first + t;
            for (let i = first; i <= Math.min(k + 1, end); ++i) turned(re, im, [i, k], [i, k + 1], ...turn, 1);
        });
        for (let k = first; k <= end; ++k) [re[k][k], im[k][k]] = [re[k][k] + x, im[k][k] + y];
    }
    return Array.from(re, (_, k) => at(k, k));
}
