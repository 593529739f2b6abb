/* Eigenvalues of a real matrix (Golub & Van Loan, "Matrix Computations", sections 7.4 and 7.5). */

/** A similar matrix, scaled by powers of 2 until each row has about the norm of its column. */
function balanced(a) {
    const whole = a.map(row => Float64Array.from(row));
    const sum = values => values.reduce((s, x) => s + Math.abs(x), 0);
    for (let again = true; again;) {
        again = false;
        for (const k of a.keys()) {
            const diagonal = Math.abs(whole[k][k]), rows = sum(whole[k]) - diagonal;
            const columns = sum(whole.map(row => row[k])) - diagonal;
            const factor = rows && columns ? 2 ** Math.round(Math.log2(rows / columns) / 2) : 1;
            if (rows / factor + columns * factor >= 0.95 * (rows + columns)) continue;
            again = true;
            whole.forEach(row => { row[k] *= factor; });
            whole[k].forEach((x, j) => { whole[k][j] = x / factor; });
        }
    }
    return whole;
}

/** A similar matrix without elements below the first subdiagonal, by elimination. Overwrites the argument. */
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

/* Complex numbers are [real, imaginary]. */
const plus = ([a, b], [c, d]) => [a + c, b + d];
const minus = ([a, b], [c, d]) => [a - c, b - d];
const multiplied = ([a, b], [c, d]) => [a * c - b * d, a * d + b * c];
const divided = ([a, b], [c, d]) => [(a * c + b * d) / (c * c + d * d), (b * c - a * d) / (c * c + d * d)];
const conjugate = ([a, b]) => [a, -b];

/** The eigenvalue of the complex matrix [[a, b], [c, d]] that is nearest to d. */
function shiftOf(a, b, c, d) {
    const half = minus(a, d).map(x => x / 2), [x, y] = plus(multiplied(half, half), multiplied(b, c));
    const size = Math.sqrt(Math.hypot(x, y)), angle = Math.atan2(y, x) / 2;
    const root = [size * Math.cos(angle), size * Math.sin(angle)];
    return half[0] * root[0] + half[1] * root[1] > 0 ? minus(plus(d, half), root) : plus(plus(d, half), root);
}

/** The eigenvalues of a real matrix, by complex QR steps with shifts. */
function eigenvalues(a) {
    const h = hessenberg(balanced(a)).map(row => Array.from(row, x => [x, 0])), found = [];
    const size = (i, j) => Math.abs(h[i][j][0]) + Math.abs(h[i][j][1]);
    for (let n = h.length - 1, steps = 0; n >= 0; ++steps) {
        if (!n || size(n, n - 1) <= 1e-16 * (size(n, n) + size(n - 1, n - 1)) || steps >= 3000) {
            found.push(h.pop().pop());
            for (const row of h) row.pop();
            --n;
            continue;
        }
        const shift = steps % 11 === 10 ? [h[n][n][0] + size(n, n - 1), 0] :
            shiftOf(h[n - 1][n - 1], h[n - 1][n], h[n][n - 1], h[n][n]);
        h.forEach((row, i) => { row[i] = minus(row[i], shift); });
        const turns = [];
        for (let k = 0; k < n; ++k) {  // rows by the conjugate of a rotation, then columns by the rotation
            const [upper, lower] = [h[k], h[k + 1]], whole = Math.hypot(...upper[k], ...lower[k]);
            const [c, s] = whole ? [upper[k], lower[k]].map(z => z.map(x => x / whole)) : [[1, 0], [0, 0]];
            turns.push([c, s]);
            h[k] = upper.map((z, j) => plus(multiplied(conjugate(c), z), multiplied(conjugate(s), lower[j])));
            h[k + 1] = lower.map((z, j) => minus(multiplied(c, z), multiplied(s, upper[j])));
        }
        turns.forEach(([c, s], k) => {
            for (const row of h) {
                [row[k], row[k + 1]] = [plus(multiplied(row[k], c), multiplied(row[k + 1], s)),
                    minus(multiplied(row[k + 1], conjugate(c)), multiplied(row[k], conjugate(s)))];
            }
        });
        h.forEach((row, i) => { row[i] = plus(row[i], shift); });
    }
    return found;
}
