/* The bed of own_bed.c for minutes and hours, while its dead time, torque gains and flange zeros drift. */
#include "own_bed.c"

/* what drifts from second `from` to second `to`, straight: dead time in s, gains as shares, zeros in N m */
typedef struct {
    double from, to, delay[2], gain[2], zero[2];
} drift;

enum { D_MODE, D_FAULT, D_FLANGE, D_ROTOR = 4, D_SENT = 6, D_GAIN = 8, D_ZERO = 12, D_DELAY = 16, D_DRIFTED = 20, D_OUT = 22 };

/* One cycle of inputs u (t, INPUTS) again and again; out (samples / every, D_OUT): readings and commands of the last
 * sample of each row. */
void run_drifting(const double *values, double speed, const double *u, int cycle, int samples, int before, double step,
                  int pieces, const int *channel, const int *known_of, const drift *away, unsigned long long seed,
                  int every, double *out)
{
    static controller c;
    plant p;
    double s[BED] = {0}, queue[LONGEST][2] = {{0}}, counts[3] = {0};
    int begun = 0;
    controller_output sent;
    memcpy(&p, values, sizeof p);
    memset(&sent, 0, sizeof sent);
    const plant planned = p;
    seeded = seed * 2654435761ull + 12345ull;
    controller_init(&c);
    s[MOTOR] = s[GEAR] = speed * p.ratio;
    s[DIFF] = speed;
    for (int i = 0; i < 2; i++) s[ADAPTER + i] = s[ROTOR + i] = speed;
    s[MOTOR_ANGLE] = even();
    s[ANGLE] = even();
    s[ANGLE + 1] = even();
    for (int n = -before; n < samples; n++) {
        const double *now = u + (n > 0 ? n % cycle : 0) * INPUTS, *after = u + (n < 0 ? 0 : (n + 1) % cycle) * INPUTS;
        const double second = n * step, part = (second - away->from) / (away->to - away->from);
        const double gone = part < 0.0 ? 0.0 : part > 1.0 ? 1.0 : part;
        controller_input in;
        double real[5] = {0};
        memset(&in, 0, sizeof in);
        for (int i = 0; i < 3; i++) {
            const double counted = floor(s[ANGLE + i] / TWO_PI * COUNTS);
            real[2 + i] = begun ? (counted - counts[i]) * TWO_PI / COUNTS / step : i < 2 ? s[ROTOR + i] : s[MOTOR];
            counts[i] = counted;
        }
        for (int i = 0; i < 2; i++) {
            real[i] = s[READ + i] * p.flange_gain[i] + gone * away->zero[i];
            p.gain[i] = planned.gain[i] * (1.0 + gone * away->gain[i]);
        }
        begun = 1;
        for (int i = 0; i < 5; i++) {
            real[i] += (i < 2 ? p.noise_torque : i < 4 ? p.noise_speed : p.noise_motor) * normal();
            if (channel[i] >= 0) in.reading[channel[i]] = real[i];
        }
        tell(&c, &in, now, known_of, speed, n, before);
        controller_step(&c, &in, &sent);
        for (int k = LONGEST - 1; k > 0; k--) memcpy(queue[k], queue[k - 1], sizeof queue[k]);
        for (int i = 0; i < 2; i++) queue[0][i] = sent.command[i];
        if (n >= 0 && n % every == every - 1) {
            double *o = out + (n / every) * D_OUT;
            o[D_MODE] = sent.mode;
            o[D_FAULT] = sent.fault;
            for (int i = 0; i < 2; i++) {
                o[D_FLANGE + i] = real[i];
                o[D_ROTOR + i] = real[2 + i];
                o[D_SENT + i] = sent.command[i];
                o[D_GAIN + 2 * i] = sent.tracked_gain[i];
                o[D_GAIN + 2 * i + 1] = sent.gain_uncertainty[i];
                o[D_ZERO + 2 * i] = sent.tracked_zero[i];
                o[D_ZERO + 2 * i + 1] = sent.zero_uncertainty[i];
                o[D_DELAY + 2 * i] = sent.tracked_delay[i];
                o[D_DELAY + 2 * i + 1] = sent.delay_uncertainty[i];
                o[D_DRIFTED + i] = sent.drifted[i];
            }
        }
        for (int q = 0; q < pieces; q++) {
            double acting[2];
            for (int i = 0; i < 2; i++) {
                const double t = (q + 0.5) / pieces * step - p.delay - gone * away->delay[i];
                int ago = 0;
                while (t + ago * step < 0.0 && ago < LONGEST - 1) ago++;
                acting[i] = queue[ago][i];
            }
            const double motor = now[U_MOTOR] + (after[U_MOTOR] - now[U_MOTOR]) * (q + 0.5) / pieces;
            bed_step(&p, s, motor, NULL, acting, step / pieces);
        }
    }
}
