/* Inputs at a time, and the rate of the augmented state X = [x, S]: state and columns of sensitivity, S (x, s). */

/* u and du: inputs and their time derivatives; linear between samples, held before the first and after the last */
static void set_inputs(Work *k, double t) {
    const Run *r = k->r;
    const double *time = r->time;
    integer last = r->samples - 1, n = r->inputs;
    if (t == k->time_of_inputs) return;
    k->time_of_inputs = t;
    for (integer i = 0; i < n; i++) {
        double at = t - k->delay[i];
        integer j = k->interval[i];
        if (at <= time[0]) { k->u[i] = r->input[i]; k->du[i] = 0; continue; }
        if (at >= time[last]) { k->u[i] = r->input[last * n + i]; k->du[i] = 0; continue; }
        while (at > time[j + 1]) j++;
        while (at < time[j]) j--;
        const double *low = r->input + j * n + i;
        if (j != k->interval[i]) k->rise[i] = (low[n] - low[0]) / (time[j + 1] - time[j]), k->interval[i] = j;
        k->du[i] = k->rise[i];
        k->u[i] = low[0] + k->rise[i] * (at - time[j]);
    }
}

/* out (m, s) += M (m, x) · S (x, s) */
static void add_product(const Pattern *M, const double *value, integer columns, const double *S, integer s, double *out) {
    for (integer j = 0; j < columns; j++)
        for (integer e = M->start[j]; e < M->start[j + 1]; e++) {
            double v = value[e];
            const double *from = S + j * s;
            double *to = out + M->row[e] * s;
            for (integer c = 0; c < s; c++) to[c] += v * from[c];
        }
}

/* out += what the parameters of the columns do directly (P) and by delaying the inputs (B) */
static void add_direct(Work *k, const Pattern *P, const double *p, const Pattern *B, const double *b, double *out) {
    const Run *r = k->r;
    integer s = r->columns;
    for (integer c = 0; c < s; c++) {
        integer j = r->selected[c];
        if (j >= 0)
            for (integer e = P->start[j]; e < P->start[j + 1]; e++) out[P->row[e] * s + c] += p[e];
        for (integer i = 0; i < r->inputs; i++) {
            double later = -k->du[i] * r->input_delay_derivative[i * s + c];
            if (later != 0)
                for (integer e = B->start[i]; e < B->start[i + 1]; e++) out[B->row[e] * s + c] += b[e] * later;
        }
    }
}

/* dX: rate of X at time t */
static void set_rate(Work *k, double t, const double *X, double *dX) {
    const Run *r = k->r;
    integer x = r->states, s = r->columns;
    set_inputs(k, t);
    const double *arg[3] = {X, k->u, k->constant};
    double *res[4] = {dX, k->A, k->B, k->P};
    r->field(arg, res, k->iw, k->w, 0);
    if (!s) return;
    memset(dX + x, 0, sizeof(double) * (size_t)(x * s));
    add_product(&r->A, k->A, x, X + x, s, dX + x);
    add_direct(k, &r->P, k->P, &r->B, k->B, dX + x);
}
