/* SPDX-License-Identifier: MIT
 *
 * The calls of the C interface in random order, with random arguments, on problems in every state: a model by functions, a mechanism
 * before and after tandem_define, sizes that are refused, a handle that was given back, NULL, and from inside of a model's functions.
 * Every call must end in a status with its message, refuse what the state does not allow, and write only where it may.
 *
 * Usage: orders [SEED [CALLS]]
 */
#include "bowl.h"
#include <limits.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

enum { SLOTS = 4, ROOM = 64, GUARD = 8, MOST = 21, WORDS = 1 << 15 };

/* State of a problem that a call needs. */
enum need {
    A_PROBLEM,  /* nothing else */
    FUNCTIONS,  /* a model by functions */
    A_MODEL,    /* one that is complete */
    KEYS,       /* a mechanism that is not complete */
    A_MECHANISM, /* one that is complete */
    A_RUN
};

enum kind { BY_FUNCTIONS, AT_ONCE, MECHANISM, WRONG_SIZES, KINDS };

struct slot {
    tandem_problem *p;
    enum kind kind;
    struct bowl bowl;
    int freed, defined, started, n, rows;
};

static struct slot slots[SLOTS], none;
static uint64_t state = 1;
static int failures, inside;
static long calls, refused, from_inside;
/* Arrays that are handed over; what is behind the part that a call may write keeps its mark. */
static double a[4][ROOM + GUARD];
static double matrix[ROOM * ROOM];
static int64_t words[WORDS];
static int saved;
static const double mark = -7.25;

static unsigned draw(unsigned n)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (unsigned)(state >> 33) % n;
}

static int some_integer(void)
{
    static const int values[] = {0, 1, 2, 3, -1, 5, 40, -1000, INT_MAX, INT_MIN};
    return values[draw(10)];
}

static double some_time(const struct slot *s)
{
    double t = 0;
    if (s->started && !inside) tandem_get_state(s->p, &t, NULL, NULL, NULL);
    switch (draw(10)) {
    case 0: return NAN;
    case 1: return INFINITY;
    case 2: return -1;
    case 3: return t;
    case 4: return 1e300;
    default: return t + 0.01 * draw(8);
    }
}

static const char *some_text(void)
{
    static const char *values[] = {"step", "rtol", "stepper", "rk4", "holonomic", "mass_matrix", "applied_force", "q", "qd", "lambda",
                                   "coordinate_scale", "breakpoints", "constant_mass", "gamma_q", "jacobian_derivative", "steps",
                                   "coordinate", "row", "unit", "radau5", "chart_kind", "sparse", "", "?", "body.bob.mass", "1.5",
                                   "world.rotation", "any", "weight_q", "fixed_qd", "mass_blocks", "potential_energy"};
    unsigned k = draw(33);
    return k == 32 ? NULL : values[k];
}

static double *array(unsigned k) { return draw(12) ? a[k] : NULL; }

/* A problem of some kind. */
static void renew(struct slot *s)
{
    memset(s, 0, sizeof *s);
    s->kind = draw(KINDS);
    s->bowl = new_bowl();
    s->n = N;
    s->rows = NC;
    if (s->kind == BY_FUNCTIONS) {
        s->p = bowl_problem(&s->bowl);
        if (draw(2)) bowl_derivatives(s->p);
    } else if (s->kind == AT_ONCE) {
        s->p = bowl_problem_at_once(&s->bowl);
    } else if (s->kind == MECHANISM) {
        s->p = tandem_new_mechanism(&s->bowl);
        s->n = s->rows = 0;
    } else {
        static const int sizes[][3] = {{0, 0, 0}, {-3, 0, 0}, {2, 3, 0}, {INT_MAX, 1, 1}, {3, -1, 1}};
        const int *three = sizes[draw(5)];
        s->p = tandem_new(three[0], three[1], three[2], &s->bowl);
        s->n = s->rows = 0;
    }
    if (s->p == NULL) {
        printf("not ok a-problem-is-made\n");
        exit(1);
    }
    /* So that no run takes long. */
    tandem_set_integer(s->p, "max_steps", 60);
}

/* The keys of a point mass on a string, and some that are wrong. */
static int set_some_key(tandem_problem *p)
{
    static const char *keys[][2] = {
        {"gravity.vector", "[0, -9.81]"}, {"body.bob.mass", "1"}, {"body.bob.position", "[-1, 0]"},
        {"constraint.string.type", "\"distance\""}, {"constraint.string.between", "[\"ground\", \"bob\"]"},
        {"body.bob.mass", "2"}, {"body.bob.mass", "\"x\""}, {"body.bob.mass", "[1, 2"}, {"", "1"}, {"nothing", "1"}};
    unsigned k = draw(40);
    if (k > 4) k = k < 38 ? k % 5 : 5 + draw(5);
    return tandem_set_key(p, keys[k][0], keys[k][1]);
}

static int orders_event(double t, const double *q, const double *qd, double *value, void *user_data)
{
    (void)t, (void)qd, (void)user_data;
    value[0] = q[0] - 0.5;
    return 0;
}

static int inner(double t, const double *q, const double *qd, double *value, void *user_data);

/* Each call, what it needs, and what it does to a run where it succeeds (1: ends it). */
static const struct {
    const char *name;
    enum need need;
    int ends_run;
} table[] = {{"set_position_function", FUNCTIONS, 1}, {"set_motion_function", FUNCTIONS, 1}, {"set_direction_function", FUNCTIONS, 1},
             {"set_evaluate", FUNCTIONS, 1}, {"set_real", A_PROBLEM, 0}, {"set_integer", A_PROBLEM, 0}, {"set_text", A_PROBLEM, 0},
             {"set_vector", A_PROBLEM, 0}, {"set_row_name", FUNCTIONS, 0}, {"add_event", A_PROBLEM, 0},
             {"add_event_function", A_PROBLEM, 0}, {"clear_events", A_PROBLEM, 0}, {"count_events", A_RUN, 0}, {"get_event", A_RUN, 0},
             {"get_stop", A_RUN, 0}, {"watch_error", A_RUN, 0}, {"estimate_error", A_RUN, 0}, {"check", FUNCTIONS, 0},
             {"assemble", A_MODEL, 0}, {"start", A_MODEL, 0}, {"integrate", A_RUN, 0}, {"step", A_RUN, 0}, {"advance", A_RUN, 0},
             {"get_state", A_RUN, 0}, {"get_state_at", A_RUN, 0}, {"get_multipliers", A_RUN, 0}, {"get_energies", A_RUN, 0},
             {"get_statistic", A_RUN, 0}, {"count_warnings", A_RUN, 0}, {"get_warning", A_RUN, 0}, {"save_state", A_RUN, 0},
             {"restore_state", A_RUN, 0}, {"linearise", A_MODEL, 0}, {"find_equilibrium", A_MODEL, 0},
             {"find_steady_motion", A_MODEL, 0}, {"set_key", KEYS, 0}, {"define", KEYS, 0}, {"get_sizes", A_PROBLEM, 0},
             {"get_drawing", A_MECHANISM, 0}, {"get_name", A_MECHANISM, 0}};
enum { CALLS = sizeof table / sizeof *table };

/* The call of that number; *writes tells how many entries of each array it may write. */
static int call(unsigned which, struct slot *s, int *writes)
{
    tandem_problem *p = s->p;
    double t = some_time(s), x, y;
    int i = some_integer(), j = draw(3) - 1, k, count = 0, status;
    char text[16];

    for (k = 0; k < 4; k++)
        for (int l = 0; l < ROOM + GUARD; l++) a[k][l] = mark;
    if (draw(4)) {
        memcpy(a[0], bowl_q, sizeof bowl_q), memcpy(a[1], bowl_qd, sizeof bowl_qd);
        if (s->kind == MECHANISM && s->defined) tandem_get_drawing(p, a[0], a[1]);
    }
    *writes = s->n;
    switch (which) {
    case 0: return tandem_set_position_function(p, some_text(), draw(2) ? bowl_phi : NULL);
    case 1:
        if (draw(3)) return tandem_set_motion_function(p, "applied_force", draw(2) ? inner : bowl_force);
        return tandem_set_motion_function(p, some_text(), draw(2) ? bowl_gamma : NULL);
    case 2: return tandem_set_direction_function(p, some_text(), draw(2) ? bowl_c2 : NULL);
    case 3: return tandem_set_evaluate(p, draw(2) ? bowl_evaluate : NULL, draw(2) ? TANDEM_PHI | TANDEM_JACOBIAN : i);
    case 4: return tandem_set_real(p, some_text(), draw(3) ? 0.001 * draw(20) : t);
    case 5: return tandem_set_integer(p, some_text(), i);
    case 6: return tandem_set_text(p, some_text(), some_text());
    case 7: return tandem_set_vector(p, some_text(), i > ROOM ? ROOM : i, array(2));
    case 8: return tandem_set_row_name(p, i, some_text());
    case 9: return tandem_add_event(p, some_text(), some_text(), draw(2) ? (int)draw(4) : i, t, j, (int)draw(2));
    case 10: return tandem_add_event_function(p, some_text(), draw(6) ? orders_event : NULL, draw(5) ? j : i, (int)draw(2));
    case 11: return tandem_clear_events(p);
    case 12: return tandem_count_events(p, draw(6) ? &count : NULL);
    case 13: return tandem_get_event(p, draw(2) ? (int)draw(3) : i, &count, &j, &x, array(0), array(1));
    case 14: return tandem_get_stop(p, draw(6) ? &count : NULL);
    case 15: return tandem_watch_error(p, t);
    case 16: return tandem_estimate_error(p);
    case 17: return tandem_check(p, t, array(0), array(1));
    case 18: return tandem_assemble(p, t, array(0), array(1));
    case 19: return tandem_start(p, draw(2) ? 0 : t, array(0), array(1));
    case 20: return tandem_integrate(p, t);
    case 21: return tandem_step(p, t);
    case 22:
        k = draw(8) ? (int)draw(s->n > 0 ? ROOM / s->n : 9) : i < 0 ? i : 0;
        *writes = k > 0 ? k * s->n : 0;
        for (int l = 0; l < k; l++) a[3][l] = t + 0.003 * l;
        status = tandem_advance(p, draw(2) ? t + 0.05 : t, draw(2) ? 7 : i, k, (int)draw(2), draw(8) ? a[3] : NULL, array(0), array(1),
                                array(2), draw(8) ? &count : NULL);
        if (count < 0 || count > (k > 0 ? k : 0)) failures++, printf("not ok advance-counts-its-rows\n    %d of %d\n", count, k);
        return status;
    case 23: return tandem_get_state(p, draw(6) ? &x : NULL, array(0), array(1), array(2));
    case 24: return tandem_get_state_at(p, t, array(0), array(1), array(2));
    case 25:
        *writes = s->rows;
        return tandem_get_multipliers(p, t, array(0));
    case 26: return tandem_get_energies(p, draw(6) ? &x : NULL, draw(6) ? &y : NULL);
    case 27: return tandem_get_statistic(p, some_text(), draw(6) ? &x : NULL);
    case 28: return tandem_count_warnings(p, draw(6) ? &count : NULL);
    case 29: return tandem_get_warning(p, draw(2) ? 0 : i, draw(3) ? (int)sizeof text : -(i % 16), draw(6) ? text : NULL);
    case 30:
        status = tandem_save_state(p, draw(3) ? WORDS : i > WORDS ? WORDS : i, draw(4) ? words : NULL, draw(4) ? &count : NULL);
        if (status == 0 && count > 0) saved = count;
        return status;
    case 31:
        if (draw(4) == 0) words[draw(saved + 1)] ^= (int64_t)1 << draw(63);
        return tandem_restore_state(p, draw(2) ? saved : i > WORDS ? WORDS : i, draw(6) ? words : NULL);
    case 32:
        *writes = 2 * s->n;
        return tandem_linearise(p, t, array(0), array(1), draw(6) ? &count : NULL, array(2), array(3), draw(2) ? matrix : NULL);
    case 33: return tandem_find_equilibrium(p, t, array(0));
    case 34: return tandem_find_steady_motion(p, t, array(0), array(1), some_text());
    case 35: return draw(10) ? set_some_key(p) : tandem_set_key(p, some_text(), some_text());
    case 36: return tandem_define(p, (int)(draw(8) > 0), (int)draw(2), 0, draw(4) ? 10 : t);
    case 37: return tandem_get_sizes(p, draw(6) ? &count : NULL, draw(6) ? &j : NULL, draw(6) ? &k : NULL);
    case 38: return tandem_get_drawing(p, array(0), array(1));
    default: return tandem_get_name(p, some_text(), draw(2) ? 0 : i, draw(3) ? (int)sizeof text : -(i % 16), draw(6) ? text : NULL);
    }
}

static void complain(unsigned which, const struct slot *s, int status, const char *what)
{
    if (failures++ > 10) return;
    printf("not ok %s-in-random-order\n    %s: call %ld, status %d, kind %d, %s%s%s: %s\n", table[which].name, what, calls, status, s->kind,
           s->freed ? "given back, " : "", s->defined ? "defined, " : "", s->started ? "started" : "not started", tandem_message(s->p));
}

/* The name of a status, with which its message begins. */
static int begins_well(const char *message, int status)
{
    static const char *names[] = {"ok", "invalid_option", "invalid_model", "inconsistent_start", "rank_deficient", "singular_mass",
                                  "callback_failed", "not_evaluable", "not_finite", "position_diverged", "chart_left",
                                  "constraints_not_held", "step_underflow", "step_limit", "output_failed", "newton_failed",
                                  "inconsistent_rows", "event_limit", "work_limit", "invalid_checkpoint", "interrupted",
                                  "no_equilibrium"};
    size_t length = strlen(names[-status]);
    return strncmp(message, names[-status], length) == 0 && message[length] == ':' && message[length + 1] == ' ';
}

/* One call, and what must hold of it. */
static int one_call(struct slot *s)
{
    unsigned which = draw(CALLS);
    enum need need;
    int writes, status, alive = s->p != NULL && !s->freed, complete, wrong;
    const char *message;

    /* Now and then the call that leads on, so that all states are reached. */
    if (draw(4) == 0) which = s->kind == MECHANISM && !s->defined ? 35 + (draw(8) == 0) : s->started ? 20 + draw(3) : 19;
    need = table[which].need;
    status = call(which, s, &writes);
    message = tandem_message(s->p);

    if (status > 0 || status < -MOST || !begins_well(message, status)) {
        complain(which, s, status, "no status with its message");
        return status;
    }
    refused += status != 0;
    for (unsigned k = 0; k < 4; k++)
        for (int l = writes > N ? writes : N; l < ROOM + GUARD; l++)
            if ((which != 22 || k != 3) && a[k][l] != mark) complain(which, s, status, "an array is written behind its end"), l = ROOM + GUARD;
    if (inside) {
        /* One of its own model's functions. */
        if (status != TANDEM_INVALID_OPTION) complain(which, s, status, "taken from a function of the model");
        return status;
    }
    complete = s->kind == MECHANISM ? s->defined : s->kind != WRONG_SIZES;
    wrong = !alive || (need == A_RUN && !s->started) || (need == FUNCTIONS && s->kind == MECHANISM) || (need == A_MODEL && !complete)
            || (need == KEYS && (s->kind != MECHANISM || s->defined)) || (need == A_MECHANISM && (s->kind != MECHANISM || !s->defined));
    if (wrong && status != TANDEM_INVALID_OPTION && status != TANDEM_INVALID_MODEL)
        complain(which, s, status, "not refused in this state");
    if (!alive) return status;
    if (which == 36 && status == 0) {
        s->defined = 1;
        tandem_get_sizes(s->p, &s->n, &s->rows, &writes);
        s->rows += writes;
    }
    /* A call that only looks tells if there is a run now. */
    s->started = tandem_get_state(s->p, NULL, NULL, NULL, NULL) == 0;
    if (table[which].ends_run && status == 0 && s->started) complain(which, s, status, "a run goes on with another model");
    if (which == 19 && status == 0 && !s->started) complain(which, s, status, "a start without a run");
    return status;
}

/* The force on the skate, whose function now and then calls the interface for its own problem. */
static int inner(double t, const double *q, const double *qd, double *value, void *user_data)
{
    struct bowl *b = user_data;
    if (!inside && draw(20) == 0) {
        static double keep[4][ROOM + GUARD];
        struct slot *s = &slots[0];
        while (&s->bowl != b) s++;
        inside = 1;
        memcpy(keep, a, sizeof a);
        from_inside++;
        one_call(s);
        if (draw(4) == 0) tandem_free(s->p);
        memcpy(a, keep, sizeof a);
        inside = 0;
    }
    return bowl_force(t, q, qd, value, user_data);
}

int main(int argc, char **argv)
{
    long wanted = argc > 2 ? atol(argv[2]) : 6000, runs = 0, defined = 0;
    int before;

    state = 88172645463325252ull ^ (uint64_t)(argc > 1 ? atol(argv[1]) : 1) << 20;
    none.freed = 1;
    for (int k = 0; k < SLOTS; k++) renew(&slots[k]);
    for (calls = 0; calls < wanted; calls++) {
        struct slot *s = &slots[draw(SLOTS)];
        if (draw(60) == 0) {
            one_call(&none);
        } else if (draw(40) == 0 && !s->freed) {
            tandem_free(s->p);
            s->freed = 1;
            s->started = 0;
        } else if (s->freed && draw(4) == 0) {
            renew(s);
        } else {
            before = s->started + 2 * s->defined;
            one_call(s);
            runs += s->started && !(before & 1);
            defined += s->defined && !(before & 2);
        }
    }
    for (int k = 0; k < SLOTS; k++) tandem_free(slots[k].p);
    printf("# %ld calls, %ld refused, %ld from inside of a function, %ld runs, %ld mechanisms\n", calls, refused, from_inside, runs, defined);
    if (wanted >= 6000 && (runs < 20 || defined < 5 || from_inside < 20)) printf("not ok orders-reach-all-states\n"), failures++;
    printf("%s calls-in-random-order\n", failures ? "not ok" : "ok");
    return failures != 0;
}
