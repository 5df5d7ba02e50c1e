/* A car and its test bed side by side, the bed under an exported controller: equations of this file alone.
 *
 * Nothing of rigmatch is used but the controller under test. Runge and Kutta's classical method, 32 steps a millisecond;
 * encoders that count, noise, lags, a dead time that is no whole number of samples. Laws from the literature: contact
 * patch with a relaxation length under the Magic Formula or a brush model (Pacejka, Tire and Vehicle Dynamics, 3rd ed.
 * 2012, sections 3.2, 4.3, 7.2), brake after Dahl with a micro-damper. Between gear and differential two clutches may
 * stand, each with its own ratio, whose friction sticks by the same law. Values come from Python, which reads the files. */
#include <math.h>
#include <string.h>

#include "controller.h"

#define SHAPE 1.65
#define STILL 0.02        /* rad/s up to which dry friction rises */
#define PAD_SETTLES 0.002 /* s */
#define COUNTS 8192.0
#define TWO_PI 6.283185307179586
#define LONGEST 64 /* samples of dead time at most */

typedef struct {
    double ratio, J_motor, drag_motor, J_gear, drag_gear, J_diff;
    double k_mesh, c_mesh, k_out, c_out, k_side[2], c_side[2];
    double J_wheel[2], J_tyre[2], J_body[2], drag_body[2], k_belt[2], c_belt[2], k_car[2], c_car[2];
    double slip[2], peak[2], brush, air[2], roll[2], pad[2];
    double J_adapter[2], J_rotor[2], drag_rotor[2], k_flange[2], c_flange[2];
    double inverter[2], gain[2], flange_lag[2], flange_gain[2], delay;
    double noise_torque, noise_speed, noise_motor;
    double gear[2], J_out, give; /* ratios of two clutches, 0: none; inertia behind them, rad that a stuck one gives */
} plant;

/* what acts on the car: motor, brakes, friction of each tyre over planned, mass over planned, torque at each body */
enum { U_MOTOR, U_BRAKE, U_MU = 3, U_MASS = 5, U_ROAD = 6, U_CLUTCH = 8, INPUTS = 10 }; /* N·m that each clutch carries */
enum { MOTOR, GEAR, DIFF, MESH, OUT, BEHIND, STUCK, SIDE = 8, WHEEL = 10, TYRE = 12, BODY = 14, BELT = 16, Z = 18, PAD = 20, CAR = 22 };
enum { ADAPTER = 10, ROTOR = 12, FLANGE = 14, AIR = 16, READ = 18, ANGLE = 20, MOTOR_ANGLE = 22, BED = 23 };
#define CLUTCH_SETTLES 2e-5 /* s */

static double front(const plant *p, const double *s, double motor, const double *carries, double *d)
{
    const double mesh = p->k_mesh * s[MESH] + p->c_mesh * (s[MOTOR] - s[GEAR]);
    const int shifts = p->gear[0] > 0.0;
    const double rate = (shifts ? s[BEHIND] : s[GEAR] / p->ratio) - s[DIFF];
    const double out = p->k_out * s[OUT] + p->c_out * rate;
    double through = out / p->ratio;
    d[BEHIND] = d[STUCK] = d[STUCK + 1] = 0.0;
    if (shifts) {
        through = 0.0;
        d[BEHIND] = -out / p->J_out;
        for (int i = 0; i < 2; i++) {
            const double slip = s[GEAR] - p->gear[i] * s[BEHIND];
            const double stuck = slip - fabs(slip) * s[STUCK + i] / p->give;
            const double torque = carries[i] * (s[STUCK + i] + CLUTCH_SETTLES * stuck) / p->give;
            d[STUCK + i] = stuck;
            d[BEHIND] += p->gear[i] * torque / p->J_out;
            through += torque;
        }
    }
    d[MOTOR] = (motor - mesh - p->drag_motor * s[MOTOR]) / p->J_motor;
    d[GEAR] = (mesh - through - p->drag_gear * s[GEAR]) / p->J_gear;
    d[MESH] = s[MOTOR] - s[GEAR];
    d[OUT] = rate;
    return out;
}

static double tyre_torque(const plant *p, int i, double linear, double mu)
{
    const double peak = p->peak[i] * mu;
    if (p->brush > 0.5) {
        if (fabs(linear) >= 3.0 * peak) return linear > 0.0 ? peak : -peak;
        return linear - linear * fabs(linear) / (3.0 * peak) + linear * linear * linear / (27.0 * peak * peak);
    }
    return peak * sin(SHAPE * atan(linear / (SHAPE * peak)));
}

static double side_torque(const plant *p, const double *s, int i, double outer)
{
    return p->k_side[i] * s[SIDE + i] + p->c_side[i] * (s[DIFF] - outer);
}

static double slip_rate(const plant *p, const double *s, int i)
{
    const double v = fabs(s[BODY + i]);
    return (p->slip[i] * (s[TYRE + i] - s[BODY + i]) - v * p->k_car[i] * s[Z + i]) / (p->slip[i] + v * p->c_car[i]);
}

/* given: torques at the wheels of a car without a drivetrain, or NULL */
static void car_rates(const plant *p, const double *s, const double *u, int pinned, const double *given, double *d)
{
    double into = 0.0;
    if (given) memset(d, 0, CAR * sizeof *d);
    else into = front(p, s, u[U_MOTOR], u + U_CLUTCH, d);
    for (int i = 0; i < 2; i++) {
        const double w = s[WHEEL + i], body = s[BODY + i], torque = given ? given[i] : side_torque(p, s, i, w);
        const double belt = p->k_belt[i] * s[BELT + i] + p->c_belt[i] * (w - s[TYRE + i]);
        const double z_rate = slip_rate(p, s, i);
        const double road = tyre_torque(p, i, p->k_car[i] * s[Z + i] + p->c_car[i] * z_rate, u[U_MU + i]);
        const double against = p->air[i] * body * fabs(body) + p->roll[i] * u[U_MASS] * tanh(body / STILL) +
                               p->drag_body[i] * body - u[U_ROAD + i];
        const double pad_rate = w - fabs(w) * s[PAD + i] / p->pad[i];
        const double braked = u[U_BRAKE + i] * (s[PAD + i] + PAD_SETTLES * pad_rate) / p->pad[i];
        d[SIDE + i] = s[DIFF] - w;
        d[WHEEL + i] = (torque - belt - braked) / p->J_wheel[i];
        d[TYRE + i] = (belt - road) / p->J_tyre[i];
        d[BODY + i] = pinned ? 0.0 : (road - against) / (p->J_body[i] * u[U_MASS]);
        d[BELT + i] = w - s[TYRE + i];
        d[Z + i] = z_rate;
        d[PAD + i] = pad_rate;
        into -= torque;
    }
    d[DIFF] = given ? 0.0 : into / p->J_diff;
}

static void bed_rates(const plant *p, const double *s, double motor, const double *carries, const double *acting,
                      double *d)
{
    double into = front(p, s, motor, carries, d);
    for (int i = 0; i < 2; i++) {
        const double torque = side_torque(p, s, i, s[ADAPTER + i]);
        const double flange = p->k_flange[i] * s[FLANGE + i] + p->c_flange[i] * (s[ADAPTER + i] - s[ROTOR + i]);
        d[SIDE + i] = s[DIFF] - s[ADAPTER + i];
        d[ADAPTER + i] = (torque - flange) / p->J_adapter[i];
        d[ROTOR + i] = (flange + p->gain[i] * s[AIR + i] - p->drag_rotor[i] * s[ROTOR + i]) / p->J_rotor[i];
        d[FLANGE + i] = s[ADAPTER + i] - s[ROTOR + i];
        d[AIR + i] = (acting[i] - s[AIR + i]) / p->inverter[i];
        d[READ + i] = (flange - s[READ + i]) / p->flange_lag[i];
        d[ANGLE + i] = s[ROTOR + i];
        into -= torque;
    }
    d[MOTOR_ANGLE] = s[MOTOR];
    d[DIFF] = into / p->J_diff;
}

static void car_step(const plant *p, double *s, const double *u, int pinned, const double *given, double h)
{
    double a[CAR], b[CAR], c[CAR], d[CAR], x[CAR];
    car_rates(p, s, u, pinned, given, a);
    for (int i = 0; i < CAR; i++) x[i] = s[i] + h / 2 * a[i];
    car_rates(p, x, u, pinned, given, b);
    for (int i = 0; i < CAR; i++) x[i] = s[i] + h / 2 * b[i];
    car_rates(p, x, u, pinned, given, c);
    for (int i = 0; i < CAR; i++) x[i] = s[i] + h * c[i];
    car_rates(p, x, u, pinned, given, d);
    for (int i = 0; i < CAR; i++) s[i] += h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
}

static void bed_step(const plant *p, double *s, double motor, const double *carries, const double *acting, double h)
{
    double a[BED], b[BED], c[BED], d[BED], x[BED];
    bed_rates(p, s, motor, carries, acting, a);
    for (int i = 0; i < BED; i++) x[i] = s[i] + h / 2 * a[i];
    bed_rates(p, x, motor, carries, acting, b);
    for (int i = 0; i < BED; i++) x[i] = s[i] + h / 2 * b[i];
    bed_rates(p, x, motor, carries, acting, c);
    for (int i = 0; i < BED; i++) x[i] = s[i] + h * c[i];
    bed_rates(p, x, motor, carries, acting, d);
    for (int i = 0; i < BED; i++) s[i] += h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
}

static unsigned long long seeded;

static double even(void)
{
    seeded = seeded * 6364136223846793005ull + 1442695040888963407ull;
    return ((double)(seeded >> 11) + 0.5) / 9007199254740992.0;
}

static double normal(void) { return sqrt(-2.0 * log(even())) * cos(TWO_PI * even()); }

int plant_doubles(void) { return (int)(sizeof(plant) / sizeof(double)); }
int plant_inputs(void) { return INPUTS; }

/* what goes wrong with one channel: from sample `from` for `samples` of them */
typedef struct {
    int channel, kind, from, samples; /* kind: 0 reads zero, 1 stuck, 2 jumps by size, 3 NaN, 4 noise of size, 5 sign */
    double size;
} wrong;

enum { OUT_MOTOR, OUT_SIDE, OUT_WHEEL = 3, OUT_BODY = 5, CAR_OUT = 7 };
enum { BED_MOTOR, BED_SIDE, BED_ROTOR = 3, BED_FLANGE = 5, BED_SENT = 7, BED_MODE = 9, BED_FAULT, BED_SEEN, BED_OFF = 19, BED_OUT = 24 };

/* The car alone: u (t, INPUTS) a sample, straight between samples, out (t, CAR_OUT). `before` samples are driven with
 * the first inputs and the bodies held at their speed. */
void run_car(const double *values, double speed, const double *u, int samples, int before, double step, int pieces,
             double *out)
{
    plant p;
    double s[CAR] = {0};
    memcpy(&p, values, sizeof p);
    s[MOTOR] = s[GEAR] = speed * p.ratio;
    s[DIFF] = s[BEHIND] = speed;
    for (int i = 0; i < 2; i++) {
        s[WHEEL + i] = s[TYRE + i] = s[BODY + i] = speed;
        s[PAD + i] = speed > 0.0 ? p.pad[i] : 0.0;
    }
    for (int n = -before; n < samples; n++) {
        const double *now = u + (n > 0 ? n : 0) * INPUTS, *after = u + (n < 0 ? 0 : n + 1 < samples ? n + 1 : n) * INPUTS;
        if (n >= 0) {
            double *o = out + n * CAR_OUT;
            o[OUT_MOTOR] = s[MOTOR];
            for (int i = 0; i < 2; i++) {
                o[OUT_SIDE + i] = side_torque(&p, s, i, s[WHEEL + i]);
                o[OUT_WHEEL + i] = s[WHEEL + i];
                o[OUT_BODY + i] = s[BODY + i];
            }
        }
        for (int q = 0; q < pieces; q++) {
            double act[INPUTS];
            for (int i = 0; i < INPUTS; i++) act[i] = now[i] + (after[i] - now[i]) * (q + 0.5) / pieces;
            car_step(&p, s, act, n < 0, NULL, step / pieces);
        }
    }
}

/* channels of the controller: 0, 1 torque flanges, 2, 3 rotors, 4 motor, as `channel` maps them to its readings */
static int ask(int n, int from, int samples) { return n >= from && n < from + samples; }

/* inputs at a time counted in samples, straight between them */
static void inputs_at(const double *u, int samples, double at, double *act)
{
    const int n = at < 0.0 ? 0 : (int)at;
    const int low = n < samples - 1 ? n : samples - 1, high = low + 1 < samples ? low + 1 : low;
    const double share = at < 0.0 || n >= samples - 1 ? 0.0 : at - n;
    for (int i = 0; i < INPUTS; i++) act[i] = u[low * INPUTS + i] + share * (u[high * INPUTS + i] - u[low * INPUTS + i]);
}

/* a car without a drivetrain, beyond the cuts, that nobody but this file steps: its steps and lateness in samples */
typedef struct {
    int steps, late;
    double speed; /* rad/s at which it begins */
} outside;

/* what the controller is told beside its readings */
static void tell(controller *c, controller_input *in, const double *now, const int *known_of, double speed, int n, int before)
{
    for (int i = 0; i < 3; i++) {
        if (known_of[i] >= 0) in->known[known_of[i]] = now[i];
    }
    for (int i = 0; i < 2; i++) {
        if (known_of[3 + i] >= 0) in->known[known_of[3 + i]] = now[U_ROAD + i];
        in->hold_speed[i] = speed;
#if CONTROLLER_VEHICLE_STATES > 0
        if (i < CONTROLLER_TYRES) c->settings.friction[i] = now[U_MU + i];
#endif
    }
#if CONTROLLER_VEHICLE_STATES > 0
    c->settings.mass = now[U_MASS];
#else
    (void)c;
#endif
    in->mode = n < 0 ? CONTROLLER_SPEED_HOLD : CONTROLLER_EMULATION;
    in->life = (uint32_t)(n + before);
}

/* The bed under the controller, `before` samples of speed hold first; out (t, BED_OUT). Known torques go where
 * known_of (motor, brake left, brake right, road left, road right) says; −1: nowhere. A shift is told from the sample
 * shift[0] to shift[1]. */
void run_bed(const double *values, double speed, double held_motor, const double *u, int samples, int before, double step,
             int pieces, const int *channel, const int *known_of, const wrong *w, int wrongs, unsigned long long seed,
             double motor_share, double missing, double sent_share_from, double sent_share, const double *beyond,
             const outside *own, const int *shift, double *out)
{
    static controller c;
    plant p;
    double s[BED] = {0}, queue[LONGEST][2] = {{0}}, counts[3] = {0}, stuck[CONTROLLER_READINGS] = {0};
    int begun = 0;
    controller_output sent;
#if CONTROLLER_FOREIGN > 0
    plant v;
    double vehicle[CAR] = {0}, answer[LONGEST][2], wheels[2] = {own->speed, own->speed};
    int is_due[LONGEST] = {0};
    memcpy(&v, beyond, sizeof v);
    for (int i = 0; i < 2; i++) {
        vehicle[WHEEL + i] = vehicle[TYRE + i] = vehicle[BODY + i] = own->speed;
        vehicle[PAD + i] = own->speed > 0.0 ? v.pad[i] : 0.0;
    }
#else
    (void)beyond;
    (void)own;
    (void)inputs_at;
#endif
    (void)held_motor;
    memcpy(&p, values, sizeof p);
    memset(&sent, 0, sizeof sent);
    seeded = seed * 2654435761ull + 12345ull;
    controller_init(&c);
    s[MOTOR] = s[GEAR] = speed * p.ratio;
    s[DIFF] = s[BEHIND] = speed;
    for (int i = 0; i < 2; i++) s[ADAPTER + i] = s[ROTOR + i] = speed;
    s[MOTOR_ANGLE] = even();
    s[ANGLE] = even();
    s[ANGLE + 1] = even();
    for (int n = -before; n < samples; n++) {
        const double *now = u + (n > 0 ? n : 0) * INPUTS, *after = u + (n < 0 ? 0 : n + 1 < samples ? n + 1 : n) * INPUTS;
        controller_input in;
        double real[5] = {s[READ] * p.flange_gain[0], s[READ + 1] * p.flange_gain[1], 0, 0, 0};
        memset(&in, 0, sizeof in);
        for (int i = 0; i < 3; i++) {
            const double counted = floor(s[ANGLE + i] / TWO_PI * COUNTS);
            const double exact = i < 2 ? s[ROTOR + i] : s[MOTOR];
            real[2 + i] = begun ? (counted - counts[i]) * TWO_PI / COUNTS / step : exact;
            counts[i] = counted;
        }
        begun = 1;
        for (int i = 0; i < 5; i++) {
            real[i] += (i < 2 ? p.noise_torque : i < 4 ? p.noise_speed : p.noise_motor) * normal();
        }
        for (int i = 0; i < 5; i++) {
            if (channel[i] < 0) continue;
            double value = real[i];
            for (int k = 0; k < wrongs; k++) {
                if (w[k].channel != i || !ask(n, w[k].from, w[k].samples)) continue;
                if (w[k].kind == 0) value = 0.0;
                if (w[k].kind == 1) value = stuck[channel[i]];
                if (w[k].kind == 2) value += w[k].size;
                if (w[k].kind == 3) value = NAN;
                if (w[k].kind == 4) value += w[k].size * normal();
                if (w[k].kind == 5) value = -value;
            }
            in.reading[channel[i]] = value;
            stuck[channel[i]] = value;
        }
        tell(&c, &in, now, known_of, speed, n, before);
        in.trigger = n >= 0;
        in.shifting = n >= shift[0] && n < shift[1];
#if CONTROLLER_FOREIGN > 0
        const int turn = (n + before) % LONGEST;
        if (is_due[turn]) {
            memcpy(wheels, answer[turn], sizeof wheels);
            is_due[turn] = 0;
        }
        for (int i = 0; i < 2; i++) in.cut_speed[i] = wheels[i];
#endif
        if (!(even() < missing && n > 0)) controller_step(&c, &in, &sent);
#if CONTROLLER_FOREIGN > 0
        if ((n + before) % own->steps == 0) { /* it goes on to the next sample with the mean torque of its step */
            const int fine = pieces * own->steps, due = (n + before + 1 + own->late) % LONGEST;
            const double into[2] = {sent.cut_torque[0], sent.cut_torque[1]};
            for (int q = 0; q < fine; q++) {
                double act[INPUTS];
                inputs_at(u, samples, n + 1 - own->steps + (q + 0.5) / pieces, act);
                car_step(&v, vehicle, act, 0, into, step / pieces);
            }
            for (int i = 0; i < 2; i++) answer[due][i] = vehicle[WHEEL + i];
            is_due[due] = 1;
        }
#endif
        for (int k = LONGEST - 1; k > 0; k--) memcpy(queue[k], queue[k - 1], sizeof queue[k]);
        for (int i = 0; i < 2; i++) queue[0][i] = sent.command[i] * (n >= sent_share_from ? sent_share : 1.0);
        if (n >= 0) {
            double *o = out + n * BED_OUT;
            o[BED_MOTOR] = s[MOTOR];
            for (int i = 0; i < 2; i++) {
                o[BED_SIDE + i] = side_torque(&p, s, i, s[ADAPTER + i]);
                o[BED_ROTOR + i] = s[ROTOR + i];
                o[BED_FLANGE + i] = p.k_flange[i] * s[FLANGE + i] + p.c_flange[i] * (s[ADAPTER + i] - s[ROTOR + i]);
                o[BED_SENT + i] = sent.command[i];
            }
            o[BED_MODE] = sent.mode;
            o[BED_FAULT] = sent.fault;
#if CONTROLLER_VEHICLE_STATES > 0
            o[BED_SEEN] = sent.vehicle_speed;
            o[BED_SEEN + 1] = sent.vehicle_distance;
            for (int i = 0; i < 2 && i < CONTROLLER_TYRES; i++) {
                o[BED_SEEN + 2 + i] = sent.slip[i];
                o[BED_SEEN + 4 + i] = sent.tyre_torque[i];
                o[BED_SEEN + 6 + i] = sent.wheel_speed[i];
            }
#endif
#if CONTROLLER_FOREIGN > 0
            o[BED_SEEN] = (vehicle[BODY] + vehicle[BODY + 1]) / 2;
            for (int i = 0; i < 2; i++) {
                o[BED_SEEN + 2 + i] = sent.cut_torque[i];
                o[BED_SEEN + 6 + i] = vehicle[WHEEL + i];
            }
#endif
            for (int i = 0; i < 5; i++) {
                if (channel[i] >= 0) o[BED_OFF + i] = c.deviation[channel[i]];
            }
        }
        for (int q = 0; q < pieces; q++) {
            const double t = (q + 0.5) / pieces * step - p.delay;
            int ago = 0;
            double acting[2];
            while (t + ago * step < 0.0 && ago < LONGEST - 1) ago++;
            for (int i = 0; i < 2; i++) acting[i] = queue[ago][i];
            const double motor = now[U_MOTOR] + (after[U_MOTOR] - now[U_MOTOR]) * (q + 0.5) / pieces;
            double carries[2];
            for (int i = 0; i < 2; i++) {
                const double from = now[U_CLUTCH + i], to = after[U_CLUTCH + i];
                carries[i] = from + (to - from) * (q + 0.5) / pieces;
            }
            bed_step(&p, s, motor * motor_share, carries, acting, step / pieces);
        }
    }
}
