/* SPDX-License-Identifier: MIT
 *
 * Tests of the C interface on the skate in a bowl: "ok NAME" or "not ok NAME" for each. It compiles as C and as C++ callers
 * see it, and everything wrong that a caller can do must end in a status and a text.
 */
#include "bowl.h"
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>

static int failures;

static void check(const char *name, int passed, const char *told)
{
    printf("%s %s\n", passed ? "ok" : "not ok", name);
    if (!passed) printf("    %s\n", told);
    failures += !passed;
}

/* The status, and a text that holds a word. */
static void expect(const char *name, tandem_problem *p, int status, int wanted, const char *word)
{
    check(name, status == wanted && strstr(tandem_message(p), word) != NULL, tandem_message(p));
}

static double energy(tandem_problem *p)
{
    double kinetic, potential;
    tandem_get_energies(p, &kinetic, &potential);
    return kinetic + potential;
}

static void run_to(tandem_problem *p, double t, double *state)
{
    if (tandem_start(p, 0, bowl_q, bowl_qd) || tandem_integrate(p, t) || tandem_get_state(p, NULL, state, state + N, NULL)) {
        printf("    %s\n", tandem_message(p));
        memset(state, 0, 2 * N * sizeof *state);
    }
}

static void test_run(void)
{
    struct bowl b = new_bowl(), all = new_bowl(), eager = new_bowl();
    tandem_problem *p = bowl_problem(&b), *one = bowl_problem_at_once(&all), *lazy = bowl_problem_at_once(&eager);
    double x[2 * N], y[2 * N], before, after, value, lambda[NC];
    eager.eager = 1;

    check("versions-agree", tandem_interface_version() == TANDEM_INTERFACE_VERSION, "header and library differ");
    tandem_start(p, 0, bowl_q, bowl_qd);
    before = energy(p);
    run_to(p, 2, x);
    after = energy(p);
    /* RK4 with 200 steps of 0.01 leaves about 1e-8 of the energy. */
    check("energy-is-constant", fabs(after - before) < 1e-6 * before && before > 1, tandem_message(p));
    check("position-constraint-holds", fabs(x[3] - b.k * (x[0] * x[0] + x[1] * x[1]) / 2) < 1e-12, "off the bowl");
    check("velocity-constraint-holds", fabs(sin(x[2]) * x[N] - cos(x[2]) * x[N + 1]) < 1e-12, "slips");
    run_to(one, 2, y);
    check("several-terms-at-once-are-bitwise-the-same", memcmp(x, y, sizeof x) == 0, tandem_message(one));
    run_to(lazy, 2, y);
    check("unwanted-terms-change-nothing", memcmp(x, y, sizeof x) == 0, tandem_message(lazy));
    tandem_set_integer(lazy, "constant_mass", 1);
    run_to(lazy, 2, y);
    check("unwanted-terms-change-no-constant-mass", memcmp(x, y, sizeof x) == 0, tandem_message(lazy));
    tandem_get_statistic(p, "steps", &value);
    check("steps-are-counted", value == 200, "not 200");
    tandem_get_multipliers(p, 2, lambda);
    check("multipliers-carry-the-weight", lambda[0] < 0 && fabs(lambda[0] + b.m * b.g) < b.m * b.g, "lambda is odd");
    tandem_free(p);
    tandem_free(one);
    tandem_free(lazy);
}

static void test_steps(void)
{
    struct bowl b = new_bowl(), whole = new_bowl();
    tandem_problem *p = bowl_problem(&b), *q = bowl_problem(&whole);
    double x[2 * N], y[2 * N], t = 0, last = 0, z[N], zd[N], zdd[N], end[N], slope;

    run_to(q, 1, y);
    tandem_start(p, 0, bowl_q, bowl_qd);
    while (t < 1) {
        if (tandem_step(p, 1)) break;
        tandem_get_state_at(p, t + 0.3 * (1 - t > 0.01 ? 0.01 : 1 - t), z, zd, NULL);
        last = t;
        tandem_get_state(p, &t, x, x + N, NULL);
    }
    check("steps-and-dense-output-are-bitwise-the-run", memcmp(x, y, sizeof x) == 0, tandem_message(p));
    tandem_get_state_at(p, t, z, zd, zdd);
    check("dense-output-at-the-end-is-the-state", memcmp(z, x, sizeof z) == 0, "another state");
    tandem_get_state_at(p, (last + t) / 2, z, zd, zdd);
    check("dense-output-is-on-the-bowl", fabs(z[3] - b.k * (z[0] * z[0] + z[1] * z[1]) / 2) < 1e-12, "off the bowl");
    tandem_get_state_at(p, (last + t) / 2 + 1e-4, end, NULL, NULL);
    tandem_get_state_at(p, (last + t) / 2 - 1e-4, x, NULL, NULL);
    slope = (end[0] - x[0]) / 2e-4;
    /* The difference quotient leaves h^2/6 of the third derivative, 1e-8. */
    check("dense-velocity-is-the-slope", fabs(slope - zd[0]) < 1e-6, "another slope");
    expect("dense-output-before-the-step-is-refused", p, tandem_get_state_at(p, last - 0.1, z, zd, zdd),
           TANDEM_INVALID_OPTION, "not within the last step");
    tandem_free(p);
    tandem_free(q);
}

/* A loop over times of output that begins with the start. */
static void test_output_times(void)
{
    struct bowl b = new_bowl(), whole = new_bowl();
    tandem_problem *p = bowl_problem(&b), *q = bowl_problem(&whole);
    double x[2 * N], y[2 * N], before, after;
    int status = 0;

    tandem_start(p, 0, bowl_q, bowl_qd);
    tandem_start(q, 0, bowl_q, bowl_qd);
    for (int i = 0; i < 3 && status == 0; i++) {
        status = tandem_integrate(p, 0.5 * i);
        if (i > 0) tandem_integrate(q, 0.5 * i);
    }
    expect("output-times-may-begin-with-the-start", p, status, TANDEM_OK, "ok");
    tandem_get_state(p, NULL, x, x + N, NULL);
    tandem_get_state(q, NULL, y, y + N, NULL);
    check("which-changes-nothing", memcmp(x, y, sizeof x) == 0, "another motion");
    tandem_get_statistic(p, "right_hand_sides", &before);
    expect("the-current-time-is-reached-already", p, tandem_integrate(p, 1), TANDEM_OK, "ok");
    tandem_get_statistic(p, "right_hand_sides", &after);
    check("and-costs-nothing", after == before && before > 0, "evaluations");
    tandem_integrate(p, 0.5);
    expect("to-be-there-clears-the-message", p, tandem_integrate(p, 1), TANDEM_OK, "ok");
    expect("an-earlier-time-is-refused", p, tandem_integrate(p, nextafter(1, 0)), TANDEM_INVALID_OPTION, "after the current time");
    tandem_free(p);
    tandem_free(q);
}

static void test_advance(void)
{
    struct bowl b = new_bowl(), whole = new_bowl();
    tandem_problem *p = bowl_problem(&b), *q = bowl_problem(&whole);
    double times[4] = {0, 0.105, 0.105, 0.3}, x[4 * N], v[4 * N], y[N], w[N], t;
    int rows = -1, same = 1;

    tandem_start(p, 0, bowl_q, bowl_qd);
    tandem_start(q, 0, bowl_q, bowl_qd);
    expect("rows-at-times", p, tandem_advance(p, 0.2, 100, 4, 0, times, x, v, NULL, &rows), TANDEM_OK, "ok");
    check("as-far-as-the-steps-came", rows == 3, tandem_message(p));
    tandem_integrate(q, 0.2);
    tandem_get_state(p, NULL, y, NULL, NULL);
    tandem_get_state(q, NULL, w, NULL, NULL);
    check("rows-leave-the-steps-alone", memcmp(y, w, sizeof y) == 0, "another motion");
    check("the-first-row-is-the-start", fabs(x[0] - bowl_q[0]) + fabs(x[1] - bowl_q[1]) < 1e-12, "elsewhere");
    tandem_start(q, 0, bowl_q, bowl_qd);
    for (t = 0; t < 0.105; tandem_get_state(q, &t, NULL, NULL, NULL)) tandem_step(q, 0.2);
    tandem_get_state_at(q, 0.105, y, w, NULL);
    check("a-row-is-dense-output", memcmp(y, x + N, sizeof y) == 0 && memcmp(w, v + 2 * N, sizeof w) == 0, "another state");
    expect("rows-at-steps", p, tandem_advance(p, 1, 3, 4, 1, times, x, NULL, NULL, &rows), TANDEM_OK, "ok");
    tandem_get_state(p, &t, y, NULL, NULL);
    for (int i = 1; i < 3; i++) same = same && times[i] > times[i - 1];
    check("as-many-as-steps", rows == 3 && same && times[2] == t && memcmp(y, x + 2 * N, sizeof y) == 0, tandem_message(p));
    tandem_advance(p, 1, 1000, 2, 1, times, NULL, NULL, NULL, &rows);
    tandem_get_state(p, &t, NULL, NULL, NULL);
    check("no-step-without-room", rows == 2 && t == times[1] && t < 1, tandem_message(p));
    expect("steps-without-rows", p, tandem_advance(p, 1, 100000, 0, 0, NULL, NULL, NULL, NULL, NULL), TANDEM_OK, "ok");
    tandem_get_state(p, &t, NULL, NULL, NULL);
    check("to-the-end", t == 1, tandem_message(p));
    expect("advance-to-the-past", p, tandem_advance(p, 0.5, 10, 0, 0, NULL, NULL, NULL, NULL, &rows), TANDEM_INVALID_OPTION, "later");
    expect("advance-to-nan", p, tandem_advance(p, NAN, 10, 0, 0, NULL, NULL, NULL, NULL, &rows), TANDEM_INVALID_OPTION, "finite");
    expect("room-without-times", p, tandem_advance(p, 2, 10, 1, 0, NULL, x, NULL, NULL, &rows), TANDEM_INVALID_OPTION, "NULL");
    times[0] = 0.5;
    expect("times-in-the-past", p, tandem_advance(p, 2, 10, 1, 0, times, x, NULL, NULL, &rows), TANDEM_INVALID_OPTION, "last step");
    check("without-a-row", rows == 0, tandem_message(p));
    tandem_free(p);
    expect("advance-of-no-problem", p, tandem_advance(p, 2, 10, 0, 0, NULL, NULL, NULL, NULL, &rows), TANDEM_INVALID_OPTION, "handle");
    tandem_free(q);
}

static void test_derivatives(void)
{
    struct bowl b = new_bowl(), plain = new_bowl();
    tandem_problem *p = bowl_problem(&b), *q = bowl_problem(&plain);
    double x[2 * N], y[2 * N], value, with, without, largest = 0;

    tandem_set_text(p, "stepper", "SDIRK54"); /* in either case */
    tandem_set_text(q, "stepper", "sdirk54");
    bowl_derivatives(p);
    run_to(p, 1, x);
    run_to(q, 1, y);
    for (int i = 0; i < 2 * N; i++) largest = fmax(largest, fabs(x[i] - y[i]));
    check("differences-stand-in-for-derivatives", largest < 1e-10 && x[0] != 0, tandem_message(q));
    tandem_get_statistic(p, "difference_evaluations", &value);
    check("given-derivatives-are-used", value == 0, "differences were taken all the same");
    tandem_get_statistic(p, "newton_corrections", &with);
    tandem_get_statistic(q, "newton_corrections", &without);
    /* A wrong entry, or a transposed matrix, would cost corrections. */
    check("given-derivatives-are-right", with <= 1.02 * without, "more corrections than with differences");
    tandem_set_motion_function(p, "gamma_q", NULL);
    run_to(p, 1, x);
    tandem_get_statistic(p, "difference_evaluations", &value);
    check("null-takes-a-function-back", value > 0, "no differences");
    tandem_free(p);
    tandem_free(q);
}

/* The message of an unknown name lists the known ones: each must be taken, with a value that it may have. */
static int takes_all(tandem_problem *p, int kind)
{
    char list[2048], *name;
    double value;
    int taken = 0;
    if (kind == 0) tandem_set_real(p, "?", 0);
    if (kind == 1) tandem_set_integer(p, "?", 0);
    if (kind == 2) tandem_get_statistic(p, "?", &value);
    snprintf(list, sizeof list, "%s", strstr(tandem_message(p), "there are ") + 10);
    for (name = strtok(list, ", "); name != NULL; name = strtok(NULL, ", ")) {
        int status = kind == 0 ? tandem_set_real(p, name, strcmp(name, "secant_limit") == 0 ? 2 : 1e-3)
                   : kind == 1 ? tandem_set_integer(p, name, 1) : tandem_get_statistic(p, name, &value);
        if (status != TANDEM_OK) return 0;
        taken++;
    }
    return taken;
}

static void test_names(void)
{
    struct bowl b = new_bowl();
    tandem_problem *p = bowl_problem(&b);
    tandem_start(p, 0, bowl_q, bowl_qd);
    check("every-statistic-is-known", takes_all(p, 2) == 74, tandem_message(p));
    check("every-real-option-is-known", takes_all(p, 0) == 18, tandem_message(p));
    check("every-integer-option-is-known", takes_all(p, 1) == 5, tandem_message(p));
    tandem_free(p);
}

/* The bowl's motion under error control: steps follow the tolerances of its coordinates, which are lists. */
static double steps_of_bowl(tandem_problem *p)
{
    double steps = 0;
    if (tandem_start(p, 0, bowl_q, bowl_qd) != 0 || tandem_integrate(p, 1) != 0) return -1;
    tandem_get_statistic(p, "steps", &steps);
    return steps;
}

static void test_tolerances(void)
{
    struct bowl b = new_bowl();
    tandem_problem *p = bowl_problem(&b);
    double loose[N], tight[N], wrong[N], with_number, with_list, with_tight, again;
    for (int i = 0; i < N; i++) {
        loose[i] = 1e-6;
        tight[i] = 1e-11;
        wrong[i] = i == 1 ? 1 : 1e-6;
    }
    tandem_set_text(p, "stepper", "dopri5");
    tandem_set_real(p, "step", 0);
    tandem_set_real(p, "rtol", 1e-6);
    with_number = steps_of_bowl(p);
    expect("tolerances-may-be-a-list", p, tandem_set_vector(p, "rtol_q", N, loose), TANDEM_OK, "ok");
    expect("absolute-ones-too", p, tandem_set_vector(p, "ATOL_Q", N, loose), TANDEM_OK, "ok");
    with_list = steps_of_bowl(p);
    tandem_set_vector(p, "rtol_qd", N, tight);
    tandem_set_vector(p, "atol_qd", N, tight);
    with_tight = steps_of_bowl(p);
    tandem_set_vector(p, "rtol_q", 0, NULL);
    tandem_set_vector(p, "atol_q", 0, NULL);
    tandem_set_vector(p, "rtol_qd", 0, NULL);
    tandem_set_vector(p, "atol_qd", 0, NULL);
    again = steps_of_bowl(p);
    check("equal-ones-are-one-number", with_number > 0 && with_list == with_number, tandem_message(p));
    check("tighter-ones-of-velocities-take-more-steps", with_tight > 2 * with_number, tandem_message(p));
    check("a-list-can-be-taken-back", again == with_number, tandem_message(p));
    expect("a-tolerance-that-cannot-be", p, tandem_set_vector(p, "rtol_q", N, wrong), TANDEM_INVALID_OPTION, "rtol_q(2) = ");
    expect("one-is-not-enough", p, tandem_set_vector(p, "rtol_q", 1, loose), TANDEM_OK, "ok");
    expect("which-the-start-says", p, tandem_start(p, 0, bowl_q, bowl_qd), TANDEM_INVALID_OPTION, "rtol_q has 1 entries");
    expect("an-unknown-list", p, tandem_set_vector(p, "rtol_x", N, loose), TANDEM_INVALID_OPTION, "atol_qd, coordinate_scale");
    tandem_free(p);
}

/* A start off the constraints is moved onto them, some of it fixed, and not too far. */
static void test_assembly(void)
{
    static const double all_but_z[N] = {1, 1, 1, 0}, all[N] = {1, 1, 1, 1};
    struct bowl b = new_bowl();
    tandem_problem *p = bowl_problem(&b);
    double q[N], qd[N], end[N], again[N], residual;
    memcpy(q, bowl_q, sizeof q);
    memcpy(qd, bowl_qd, sizeof qd);
    q[3] += 0.05;
    qd[1] -= 0.1;
    expect("a-start-off-the-constraints-can-be-moved", p, tandem_start(p, 0, q, qd), TANDEM_INCONSISTENT_START,
           "or move them by tandem_assemble");
    tandem_set_vector(p, "fixed_q", N, all_but_z);
    expect("a-start-is-assembled", p, tandem_assemble(p, 0, q, qd), TANDEM_OK, "ok");
    /* The tolerance is 1e-12 of the size of the terms, about 1. */
    check("what-is-fixed-stays", memcmp(q, bowl_q, 3 * sizeof *q) == 0 && fabs(q[3] - 0.2) < 1e-11, tandem_message(p));
    residual = fmax(fabs(sin(q[2]) * qd[0] - cos(q[2]) * qd[1]), fabs(qd[3] - b.k * (q[0] * qd[0] + q[1] * qd[1])));
    check("velocities-satisfy-the-constraints", residual < 1e-11, tandem_message(p));
    expect("a-run-starts-there", p, tandem_start(p, 0, q, qd), TANDEM_OK, "ok");

    /* A run does not notice. */
    tandem_integrate(p, 0.5);
    tandem_integrate(p, 1);
    tandem_get_state(p, NULL, end, NULL, NULL);
    tandem_start(p, 0, q, qd);
    tandem_integrate(p, 0.5);
    memcpy(again, bowl_q, sizeof again);
    again[3] += 0.05;
    tandem_assemble(p, 0, again, qd);
    tandem_integrate(p, 1);
    tandem_get_state(p, NULL, again, NULL, NULL);
    check("a-run-goes-on-as-if-nothing-was-assembled", memcmp(end, again, sizeof end) == 0, tandem_message(p));

    memcpy(q, bowl_q, sizeof q);
    q[3] += 0.05;
    tandem_set_vector(p, "fixed_q", N, all);
    expect("where-nothing-may-move-there-is-none", p, tandem_assemble(p, 0, q, qd), TANDEM_INCONSISTENT_START, "holonomic 1");
    tandem_set_vector(p, "fixed_q", 0, NULL);
    tandem_set_real(p, "largest_move_q", 1e-3);
    expect("nor-too-far-away", p, tandem_assemble(p, 0, q, qd), TANDEM_INCONSISTENT_START, "would move by");
    check("what-cannot-be-moved-stays", q[0] == bowl_q[0] && q[3] == bowl_q[3] + 0.05, tandem_message(p));
    tandem_set_real(p, "LARGEST_MOVE_Q", 0);
    expect("without-limit-it-is-moved", p, tandem_assemble(p, 0, q, qd), TANDEM_OK, "ok");
    check("all-of-it", q[0] != bowl_q[0], tandem_message(p));
    expect("weights-are-one-a-coordinate", p, tandem_set_vector(p, "weight_q", 1, all), TANDEM_OK, "ok");
    expect("or-refused", p, tandem_assemble(p, 0, q, qd), TANDEM_INVALID_OPTION, "weight_q has 1 entries");
    expect("a-negative-limit", p, tandem_set_real(p, "largest_move_qd", -1), TANDEM_INVALID_OPTION, "must be positive");
    expect("another-metric", p, tandem_set_text(p, "velocity_metric", "Weights"), TANDEM_OK, "ok");
    expect("an-unknown-metric", p, tandem_set_text(p, "velocity_metric", "massive"), TANDEM_INVALID_OPTION, "use mass or weights");
    expect("a-metric-is-no-number", p, tandem_set_real(p, "velocity_metric", 1), TANDEM_INVALID_OPTION, "not a real option");
    expect("no-state-to-assemble", p, tandem_assemble(p, 0, NULL, qd), TANDEM_INVALID_OPTION, "NULL");
    tandem_free(p);
}

/* The heading is 0.5 + 0.7 t: it passes 1.2 at t = 1. The fault of "event" is the function's own. */
static int heading(double t, const double *q, const double *qd, double *value, void *user_data)
{
    struct bowl *b = user_data;
    (void)qd;
    if (b->fault == GIVE_NAN) return 0; /* sets nothing */
    value[0] = q[2] - 1.2;
    return bowl_end(b, "event", t, value);
}

static void test_events(void)
{
    struct bowl b = new_bowl(), plain = new_bowl();
    tandem_problem *p = bowl_problem(&b), *r = bowl_problem(&plain);
    double x[2 * N], y[2 * N], q[N], qd[N], t = 0, time = 0;
    int count = -1, event = -1, direction = 9, again = 0, status = 0;
    static int64_t words[20000];

    expect("a-coordinate-is-watched", p, tandem_add_event(p, "half", "Q", 2, 0.85, 1, 0), TANDEM_OK, "ok");
    expect("a-function-is-watched", p, tandem_add_event_function(p, "turned", heading, 0, 0), TANDEM_OK, "ok");
    expect("a-multiplier-is-watched", p, tandem_add_event(p, "lifts", "lambda", 0, 0, 0, 0), TANDEM_OK, "ok");
    expect("a-falling-one-is-watched", p, tandem_add_event(p, "back", "q", 2, 0.85, -1, 1), TANDEM_OK, "ok");
    run_to(r, 2, y);
    run_to(p, 2, x);
    check("what-only-records-changes-nothing", memcmp(x, y, sizeof x) == 0, "another motion");
    expect("events-are-counted", p, tandem_count_events(p, &count), TANDEM_OK, "ok");
    check("two-have-happened", count == 2, "not two");
    expect("the-first-is-told", p, tandem_get_event(p, 0, &event, &direction, &t, q, qd), TANDEM_OK, "ok");
    /* A zero is found to 1e-13 of a step, where the heading is right to rounding. */
    check("which-is-the-coordinate", event == 0 && direction == 1 && fabs(t - 0.5) < 1e-12 && fabs(q[2] - 0.85) < 1e-12 &&
          fabs(qd[2] - 0.7) < 1e-12, "another event");
    check("then-the-function", tandem_get_event(p, 1, &event, &direction, &t, NULL, NULL) == 0 && event == 1 && direction == 1 &&
          fabs(t - 1) < 1e-12, "another event");
    expect("there-are-no-more", p, tandem_get_event(p, 2, &event, &direction, &t, q, qd), TANDEM_INVALID_OPTION, "has recorded 2");
    expect("none-before-the-first", p, tandem_get_event(p, -1, NULL, NULL, NULL, NULL, NULL), TANDEM_INVALID_OPTION, "no such");
    check("nothing-has-stopped-the-run", tandem_get_stop(p, &event) == 0 && event == -1, tandem_message(p));

    /* One more that stops counts from the next start on. */
    tandem_start(p, 0, bowl_q, bowl_qd);
    tandem_add_event(p, "stop", "qd", 3, 0, 0, 1);
    tandem_clear_events(p);
    tandem_integrate(p, 2);
    tandem_count_events(p, &count);
    check("a-run-keeps-the-events-of-its-start", count == 2, tandem_message(p));
    tandem_add_event_function(p, "stop", heading, 1, 1);
    tandem_start(p, 0, bowl_q, bowl_qd);
    expect("a-run-may-be-stopped", p, tandem_integrate(p, 2), TANDEM_OK, "ok");
    tandem_get_state(p, &t, q, NULL, NULL);
    check("it-ends-at-the-event", fabs(t - 1) < 1e-12 && fabs(q[2] - 1.2) < 1e-12, "elsewhere");
    check("which-is-named", tandem_get_stop(p, &event) == 0 && event == 0, tandem_message(p));
    check("the-state-is-on-the-bowl", fabs(q[3] - b.k * (q[0] * q[0] + q[1] * q[1]) / 2) < 1e-12, "off the bowl");
    tandem_save_state(p, 20000, words, &count);
    expect("and-goes-on", p, tandem_integrate(p, 2), TANDEM_OK, "ok");
    tandem_get_state(p, &t, x, x + N, NULL);
    check("to-the-end", t == 2 && tandem_get_stop(p, &event) == 0 && event == -1, "stopped again");
    tandem_start(p, 0, bowl_q, bowl_qd);
    expect("a-saved-run-has-its-events", p, tandem_restore_state(p, count, words), TANDEM_OK, "ok");
    check("and-what-has-stopped-it", tandem_get_stop(p, &event) == 0 && event == 0 && tandem_count_events(p, &again) == 0 &&
          again == 1, tandem_message(p));
    tandem_integrate(p, 2);
    tandem_get_state(p, NULL, y, y + N, NULL);
    check("bitwise-as-without-the-break", memcmp(x, y, sizeof x) == 0, "another motion");
    tandem_start(r, 0, bowl_q, bowl_qd);
    expect("which-a-run-without-them-refuses", r, tandem_restore_state(r, count, words), TANDEM_INVALID_CHECKPOINT, "events");
    tandem_start(p, 0, bowl_q, bowl_qd);
    for (t = 0, event = -1; t < 2 && event < 0 && status == 0; tandem_get_stop(p, &event)) {
        status = tandem_step(p, 2);
        tandem_get_state(p, &t, NULL, NULL, NULL);
    }
    tandem_get_event(p, 0, NULL, NULL, &time, NULL, NULL);
    check("single-steps-stop-there-too", t == time && fabs(t - 1) < 1e-12 && event == 0, tandem_message(p));

    b.faulty = "event";
    b.fault = RETRY;
    tandem_start(p, 0, bowl_q, bowl_qd);
    expect("a-function-that-fails-is-named", p, tandem_integrate(p, 2), TANDEM_CALLBACK_FAILED,
           "event \"stop\" returned the status 1");
    b.fault = GIVE_INFINITY;
    tandem_start(p, 0, bowl_q, bowl_qd);
    expect("and-one-that-is-infinite", p, tandem_integrate(p, 2), TANDEM_NOT_FINITE, "event \"stop\"");
    b.fault = GIVE_NAN;
    tandem_start(p, 0, bowl_q, bowl_qd);
    expect("and-one-that-sets-nothing", p, tandem_integrate(p, 2), TANDEM_CALLBACK_FAILED, "event \"stop\"");
    b.fault = NONE;

    expect("no-name", p, tandem_add_event(p, NULL, "q", 0, 0, 0, 0), TANDEM_INVALID_OPTION, "no name");
    expect("the-name-of-another", p, tandem_add_event(p, "stop", "q", 0, 0, 0, 0), TANDEM_INVALID_OPTION, "another event");
    expect("no-quantity", p, tandem_add_event(p, "x", NULL, 0, 0, 0, 0), TANDEM_INVALID_OPTION, "use q, qd or lambda");
    expect("another-quantity", p, tandem_add_event(p, "x", "lambdas", 0, 0, 0, 0), TANDEM_INVALID_OPTION, "\"lambdas\"");
    expect("no-such-coordinate", p, tandem_add_event(p, "x", "q", N, 0, 0, 0), TANDEM_INVALID_OPTION, "it has 4 entries");
    expect("nor-one-before", p, tandem_add_event(p, "x", "q", -1, 0, 0, 0), TANDEM_INVALID_OPTION, "it has 4 entries");
    expect("no-such-constraint", p, tandem_add_event(p, "x", "lambda", NC, 0, 0, 0), TANDEM_INVALID_OPTION, "it has 2 entries");
    expect("no-such-direction", p, tandem_add_event(p, "x", "q", 0, 0, 2, 0), TANDEM_INVALID_OPTION, "direction 2");
    expect("a-value-that-is-nan", p, tandem_add_event(p, "x", "q", 0, NAN, 0, 0), TANDEM_INVALID_OPTION, "not finite");
    expect("a-function-that-is-null", p, tandem_add_event_function(p, "x", NULL, 0, 0), TANDEM_INVALID_OPTION, "no function");
    expect("a-name-of-ninety-seven", p, tandem_add_event(p, "ninety-seven characters are a lot "
           "xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx", "q", 0, 0, 0, 0), TANDEM_INVALID_OPTION, "96");
    check("what-was-refused-is-not-there", tandem_start(p, 0, bowl_q, bowl_qd) == 0 && tandem_integrate(p, 2) == 0 &&
          tandem_count_events(p, &count) == 0 && count == 1, tandem_message(p));
    tandem_free(p);
    tandem_free(r);
}

/* The error of a run with steps of 0.05, beside one with an eighth of them: its error is 1/4096 of that. */
static void test_error(void)
{
    struct bowl b = new_bowl(), fine = new_bowl(), plain = new_bowl();
    tandem_problem *p = bowl_problem(&b), *exact = bowl_problem(&fine), *r = bowl_problem(&plain);
    double x[2 * N], y[2 * N], z[2 * N], error = 0, told = -1, largest = -1, when = -1, value, t = 0, evaluations = 0, after = 0;
    int count;
    static int64_t words[20000];

    tandem_set_real(p, "step", 0.05);
    tandem_set_real(r, "step", 0.05);
    tandem_set_real(exact, "step", 0.00625);
    run_to(exact, 2, y);
    run_to(r, 2, z);
    tandem_start(p, 0, bowl_q, bowl_qd);
    expect("no-error-of-a-run-not-watched", p, tandem_estimate_error(p), TANDEM_INVALID_OPTION, "call tandem_watch_error there");
    expect("a-run-is-watched", p, tandem_watch_error(p, 2), TANDEM_OK, "ok");
    tandem_integrate(p, 1);
    expect("no-error-before-the-end", p, tandem_estimate_error(p), TANDEM_INVALID_OPTION,
           "the end passed to tandem_watch_error");
    expect("nor-a-figure", p, tandem_get_statistic(p, "global_error_q", &value), TANDEM_INVALID_OPTION, "not a statistic");
    tandem_integrate(p, 2);
    tandem_get_state(p, NULL, x, x + N, NULL);
    check("to-be-watched-changes-nothing", memcmp(x, z, sizeof x) == 0, tandem_message(p));
    tandem_get_statistic(p, "right_hand_sides", &evaluations);
    expect("the-error-is-estimated", p, tandem_estimate_error(p), TANDEM_OK, "ok");
    for (int i = 0; i < N; i++) error = fmax(error, fabs(x[i] - y[i]));
    tandem_get_statistic(p, "global_error_q", &told);
    /* An estimate is right to a factor of two. */
    check("and-right", error > 1e-9 && told > error / 2 && told < 2 * error, tandem_message(p));
    tandem_get_statistic(p, "Global_Error_Largest", &largest);
    tandem_get_statistic(p, "global_error_time", &when);
    tandem_get_statistic(p, "global_error", &value);
    check("it-is-largest-once", largest >= value && value > 0 && when > 0 && when <= 2, tandem_message(p));
    tandem_get_statistic(p, "global_error_right_hand_sides", &value);
    tandem_get_statistic(p, "right_hand_sides", &after);
    check("the-second-run-counts-apart", value > 1.5 * evaluations && after == evaluations, tandem_message(p));
    check("every-statistic-is-known-then", takes_all(p, 2) == 82, tandem_message(p));
    tandem_integrate(p, 3);
    tandem_integrate(r, 3);
    tandem_get_state(p, NULL, x, x + N, NULL);
    tandem_get_state(r, NULL, z, z + N, NULL);
    check("a-run-goes-on-as-if-nothing-was-estimated", memcmp(x, z, sizeof x) == 0, tandem_message(p));

    /* In single steps, past the end; and in one call past it. */
    tandem_start(p, 0, bowl_q, bowl_qd);
    expect("a-start-forgets-the-error", p, tandem_get_statistic(p, "global_error_q", &value), TANDEM_INVALID_OPTION, "not a");
    tandem_watch_error(p, 2);
    for (t = 0; t < 2.5 && tandem_step(p, 2.5) == 0;) tandem_get_state(p, &t, NULL, NULL, NULL);
    value = -1;
    tandem_estimate_error(p);
    tandem_get_statistic(p, "global_error_q", &value);
    check("single-steps-are-watched-too", value == told, tandem_message(p));
    tandem_start(p, 0, bowl_q, bowl_qd);
    tandem_watch_error(p, 2);
    tandem_integrate(p, 2.5);
    value = -1;
    expect("a-run-may-go-past-the-end", p, tandem_estimate_error(p), TANDEM_OK, "ok");
    tandem_get_statistic(p, "global_error_q", &value);
    check("which-changes-no-error", value == told, tandem_message(p));

    expect("a-run-that-has-left-its-start", p, tandem_watch_error(p, 4), TANDEM_INVALID_OPTION, "left its start");
    tandem_start(p, 0, bowl_q, bowl_qd);
    expect("an-end-that-is-the-start", p, tandem_watch_error(p, 0), TANDEM_INVALID_OPTION, "after the start");
    expect("an-end-that-is-infinite", p, tandem_watch_error(p, INFINITY), TANDEM_INVALID_OPTION, "finite");
    tandem_watch_error(p, 2);
    tandem_integrate(p, 1);
    tandem_save_state(p, 20000, words, &count);
    tandem_restore_state(p, count, words);
    tandem_integrate(p, 2);
    expect("a-saved-run-is-not-watched", p, tandem_estimate_error(p), TANDEM_INVALID_OPTION, "call tandem_watch_error there");

    tandem_add_event_function(p, "stop", heading, 0, 1);
    tandem_start(p, 0, bowl_q, bowl_qd);
    tandem_watch_error(p, 2);
    tandem_integrate(p, 2);
    expect("no-error-where-an-event-has-stopped", p, tandem_estimate_error(p), TANDEM_INVALID_OPTION, "stopped the run");
    expect("but-it-may-go-on", p, tandem_integrate(p, 2), TANDEM_OK, "ok");
    expect("and-be-estimated", p, tandem_estimate_error(p), TANDEM_OK, "ok");

    /* A step that is far too large: the warnings tell. */
    tandem_clear_events(p);
    tandem_set_real(p, "step", 0.5);
    tandem_start(p, 0, bowl_q, bowl_qd);
    tandem_watch_error(p, 20);
    if (tandem_integrate(p, 20) == 0 && tandem_estimate_error(p) == 0) tandem_count_warnings(p, &count);
    char text[400] = "";
    for (int i = 0; i < count && strstr(text, "the error reaches") == NULL; i++) tandem_get_warning(p, i, sizeof text, text);
    check("a-large-error-is-warned-of", strstr(text, "the error reaches") != NULL, tandem_message(p));
    tandem_free(p);
    tandem_free(r);
    tandem_free(exact);
}

/* Statistics go by the names that reports have, in either case, and three by those that they had before, too. */
static void test_statistics(void)
{
    static const char *reasons[] = {"start", "every_step", "v", "w", "D", "Fbar", "breakpoint", "condition", "iterations", "failure",
                                    "event"};
    static const char *pairs[][2] = {{"position_error", "largest_position_error"},
                                     {"velocity_error", "LARGEST_VELOCITY_ERROR"},
                                     {"Acceleration_Error", "largest_acceleration_error"},
                                     {"b_corrections", "B_corrections"},
                                     {"is_stiff", "stiff"}};
    struct bowl b = new_bowl();
    tandem_problem *p = bowl_problem(&b);
    double charts = 0, sum = 0, forces = 0, old, new;
    char name[40];
    int same = 0;
    tandem_start(p, 0, bowl_q, bowl_qd);
    tandem_integrate(p, 0.5);
    for (int i = 0; i < 11; i++) {
        snprintf(name, sizeof name, "charts_by_%s", reasons[i]);
        new = -1;
        tandem_get_statistic(p, name, &new);
        sum += new;
    }
    tandem_get_statistic(p, "charts", &charts);
    check("every-chart-has-a-reason", charts > 0 && sum == charts, tandem_message(p));
    tandem_get_statistic(p, "evaluations_force", &forces);
    check("evaluations-are-told-term-by-term", forces > 0, tandem_message(p));
    for (int i = 0; i < 5; i++) {
        old = 1;
        new = 2;
        tandem_get_statistic(p, pairs[i][0], &old);
        tandem_get_statistic(p, pairs[i][1], &new);
        same += old == new;
    }
    check("statistics-keep-their-old-names", same == 5, tandem_message(p));
    strcpy(name, "steps");
    memset(name + 5, 'x', sizeof name - 6);
    name[39] = 0;
    expect("a-long-name-is-no-statistic", p, tandem_get_statistic(p, name, &old), TANDEM_INVALID_OPTION, "is not a statistic");
    tandem_free(p);
}

/* The bowl twice over: one of the rows is redundant. */
static int twice_phi(double t, const double *q, double *value, void *user_data)
{
    int status = bowl_phi(t, q, value, user_data);
    value[1] = value[0];
    return status;
}

static int twice_phi_q(double t, const double *q, double *value, void *user_data)
{
    int status = bowl_phi_q(t, q, value, user_data);
    memcpy(value + N, value, N * sizeof *value);
    return status;
}

static void test_warnings(void)
{
    struct bowl b = new_bowl();
    tandem_problem *p = bowl_problem(&b);
    double value, sum, largest, stiff;
    char text[400], cut[5] = {1, 1, 1, 1, 1};
    int count = -1;

    expect("no-warnings-before-the-start", p, tandem_count_warnings(p, &count), TANDEM_INVALID_OPTION, "tandem_start");
    check("and-they-are-none", count == 0, "some");
    tandem_start(p, 0, bowl_q, bowl_qd);
    tandem_integrate(p, 2);
    expect("a-good-run-has-no-warning", p, tandem_count_warnings(p, &count), TANDEM_OK, "ok");
    check("not-one", count == 0, "some");
    expect("there-is-no-first", p, tandem_get_warning(p, 0, sizeof text, text), TANDEM_INVALID_OPTION, "the run has 0");
    check("its-text-is-empty", text[0] == 0, text);
    tandem_get_statistic(p, "local_error_sum", &sum);
    tandem_get_statistic(p, "local_error", &largest);
    tandem_get_statistic(p, "is_stiff", &stiff);
    /* RK4 with h = 0.01 leaves some 1e-10 a step. */
    check("the-errors-of-steps-are-told", sum > 1e-12 && sum < 1e-5 && largest > 0 && largest < sum, tandem_message(p));
    check("and-that-nothing-is-stiff", stiff == 0, "stiff");

    tandem_set_real(p, "step", 0.25);
    tandem_start(p, 0, bowl_q, bowl_qd);
    tandem_integrate(p, 10);
    expect("a-wrong-run-has-a-warning", p, tandem_count_warnings(p, &count), TANDEM_OK, "ok");
    expect("which-is-given", p, tandem_get_warning(p, 0, sizeof text, text), TANDEM_OK, "ok");
    check("and-says-what-to-do", count > 0 && strstr(text, "take smaller steps") != NULL, text);
    expect("a-long-warning-is-cut", p, tandem_get_warning(p, 0, sizeof cut - 1, cut), TANDEM_OK, "ok");
    check("where-its-room-ends", strlen(cut) == 3 && strncmp(cut, text, 3) == 0 && cut[4] == 1, cut);
    expect("there-is-none-behind-the-last", p, tandem_get_warning(p, count, sizeof text, text), TANDEM_INVALID_OPTION, "no such");
    expect("nor-before-the-first", p, tandem_get_warning(p, -1, sizeof text, text), TANDEM_INVALID_OPTION, "no such");
    expect("nor-at-the-largest-integer", p, tandem_get_warning(p, INT_MAX, sizeof text, text), TANDEM_INVALID_OPTION, "no such");
    expect("a-warning-needs-a-place", p, tandem_get_warning(p, 0, 10, NULL), TANDEM_INVALID_OPTION, "NULL");
    expect("and-room", p, tandem_get_warning(p, 0, 0, text), TANDEM_INVALID_OPTION, "capacity");
    tandem_free(p);

    b = new_bowl();
    p = tandem_new(N, 2, 0, &b);
    tandem_set_position_function(p, "holonomic", twice_phi);
    tandem_set_position_function(p, "holonomic_jacobian", twice_phi_q);
    tandem_set_position_function(p, "mass_matrix", bowl_mass);
    tandem_set_motion_function(p, "applied_force", bowl_force);
    tandem_set_row_name(p, 1, "bowl again");
    tandem_start(p, 0, bowl_q, bowl_qd);
    tandem_get_statistic(p, "n_redundant", &value);
    check("redundant-rows-are-counted", value == 1, tandem_message(p));
    tandem_count_warnings(p, &count);
    tandem_get_warning(p, 0, sizeof text, text);
    check("and-named-by-a-warning", count == 1 && strstr(text, "\"bowl again\"") != NULL, text);
    tandem_free(p);
}

/* A force that is switched on at t = 0.5: one whole step of 0.3 would pass it. */
static int switched(double t, const double *q, const double *qd, double *value, void *user_data)
{
    tandem_problem *p = *(tandem_problem **)user_data;
    (void)t, (void)q, (void)qd;
    value[0] = tandem_get_segment(p) == 1 ? 0 : 2;
    return 0;
}

static int unit_mass(double t, const double *q, double *value, void *user_data)
{
    (void)t, (void)q, (void)user_data;
    value[0] = 1;
    return 0;
}

static void test_breakpoints(void)
{
    tandem_problem *p;
    double q = 0, qd = 0, at = 0.5, twice[2] = {0.5, 0.5};
    p = tandem_new(1, 0, 0, &p);
    tandem_set_position_function(p, "mass_matrix", unit_mass);
    tandem_set_motion_function(p, "applied_force", switched);
    tandem_set_real(p, "step", 0.3);
    expect("breakpoints-are-taken", p, tandem_set_vector(p, "breakpoints", 1, &at), TANDEM_OK, "ok");
    tandem_start(p, 0, &q, &qd);
    tandem_integrate(p, 1);
    tandem_get_state(p, NULL, &q, &qd, NULL);
    check("segments-switch-at-the-breakpoint", fabs(q - 0.25) < 1e-14 && fabs(qd - 1) < 1e-14, tandem_message(p));
    tandem_set_vector(p, "nu_jumps", 1, &at);
    tandem_set_vector(p, "breakpoints", 0, NULL);
    expect("jumps-without-breakpoints-are-refused", p, tandem_start(p, 0, &q, &qd), TANDEM_INVALID_MODEL, "nu_jumps");
    tandem_set_vector(p, "breakpoints", 1, &at);
    tandem_set_vector(p, "nu_jumps", 0, NULL);
    expect("jumps-are-taken-back-alone", p, tandem_start(p, 0, &q, &qd), TANDEM_OK, "ok");
    tandem_set_vector(p, "breakpoints", 2, twice);
    expect("breakpoints-that-do-not-ascend-are-refused", p, tandem_start(p, 0, &q, &qd), TANDEM_INVALID_MODEL, "ascend");
    tandem_set_vector(p, "breakpoints", 0, NULL);
    expect("an-empty-list-is-taken", p, tandem_start(p, 0, &q, &qd), TANDEM_OK, "ok");
    tandem_free(p);
}

/* A bead in polar coordinates (r, angle, z), driven so that angle' = w r and z = c sin t: r'^2/2 - w^2 r^4/4 is constant. It has the
   functions that the bowl does not need; each counts its calls. */
enum { RATE, RHS, RHS_Q, INERTIA, KINETIC, MASS_Q, COUNTED };
static const double bead_w = 0.5, bead_c = 0.2, bead_m = 2.0;

static int bead_phi(double t, const double *q, double *value, void *calls)
{
    (void)calls;
    value[0] = q[2] - bead_c * sin(t);
    return 0;
}

static int bead_phi_q(double t, const double *q, double *value, void *calls)
{
    (void)t, (void)q, (void)calls;
    value[0] = value[1] = 0;
    value[2] = 1;
    return 0;
}

static int bead_phi_t(double t, const double *q, double *value, void *calls)
{
    (void)q;
    ((int *)calls)[RATE]++;
    value[0] = -bead_c * cos(t);
    return 0;
}

static int bead_e(double t, const double *q, double *value, void *calls)
{
    (void)t, (void)q, (void)calls;
    value[0] = value[2] = 0;
    value[1] = 1;
    return 0;
}

static int bead_rhs(double t, const double *q, double *value, void *calls)
{
    (void)t;
    ((int *)calls)[RHS]++;
    value[0] = bead_w * q[0];
    return 0;
}

static int bead_nu_q(double t, const double *q, double *value, void *calls)
{
    (void)t, (void)q;
    ((int *)calls)[RHS_Q]++;
    memset(value, 0, 6 * sizeof *value);
    value[3] = bead_w;
    return 0;
}

static int bead_gamma(double t, const double *q, const double *qd, double *value, void *calls)
{
    (void)q, (void)calls;
    value[0] = bead_c * sin(t);
    value[1] = -bead_w * qd[0];
    return 0;
}

static int bead_mass(double t, const double *q, double *value, void *calls)
{
    (void)t, (void)calls;
    memset(value, 0, 9 * sizeof *value);
    value[0] = value[8] = bead_m;
    value[4] = bead_m * q[0] * q[0];
    return 0;
}

static int bead_mass_q(double t, const double *q, const double *x, double *value, void *calls)
{
    (void)t;
    ((int *)calls)[MASS_Q]++;
    memset(value, 0, 9 * sizeof *value);
    value[3] = 2 * bead_m * q[0] * x[1];
    return 0;
}

static int bead_inertia(double t, const double *q, const double *qd, double *value, void *calls)
{
    (void)t;
    ((int *)calls)[INERTIA]++;
    value[0] = bead_m * q[0] * qd[1] * qd[1];
    value[1] = -2 * bead_m * q[0] * qd[0] * qd[1];
    value[2] = 0;
    return 0;
}

static int bead_kinetic(double t, const double *q, const double *qd, double *value, void *calls)
{
    (void)t;
    ((int *)calls)[KINETIC]++;
    value[0] = bead_m * (qd[0] * qd[0] + q[0] * q[0] * qd[1] * qd[1] + qd[2] * qd[2]) / 2;
    return 0;
}

static void test_driven(void)
{
    int calls[COUNTED] = {0};
    double q[3] = {1, 0, 0}, qd[3] = {0.1, 0.5, 0.2}, before, after, kinetic, by_mass;
    tandem_problem *p = tandem_new(3, 1, 1, calls);
    tandem_set_position_function(p, "holonomic", bead_phi);
    tandem_set_position_function(p, "holonomic_jacobian", bead_phi_q);
    tandem_set_position_function(p, "holonomic_rate", bead_phi_t);
    tandem_set_position_function(p, "nonholonomic_jacobian", bead_e);
    tandem_set_position_function(p, "nonholonomic_rhs", bead_rhs);
    tandem_set_position_function(p, "nu_derivative", bead_nu_q);
    tandem_set_motion_function(p, "constraint_acceleration", bead_gamma);
    tandem_set_position_function(p, "mass_matrix", bead_mass);
    tandem_set_direction_function(p, "mass_derivative", bead_mass_q);
    tandem_set_motion_function(p, "inertia_force", bead_inertia);
    tandem_set_motion_function(p, "kinetic_energy", bead_kinetic);
    tandem_set_text(p, "stepper", "sdirk54");
    tandem_set_text(p, "chart", "adaptive");
    tandem_set_text(p, "refresh", "factor");
    tandem_set_text(p, "basis", "svd");
    expect("functions-of-time-pass-the-check", p, tandem_check(p, 0.3, q, qd), TANDEM_OK, "ok");
    tandem_set_position_function(p, "holonomic_rate", NULL);
    expect("the-check-misses-a-rate", p, tandem_check(p, 0.3, q, qd), TANDEM_INVALID_MODEL, "holonomic_rate is missing");
    tandem_set_position_function(p, "holonomic_rate", bead_phi_t);
    memset(calls, 0, sizeof calls);
    tandem_set_real(p, "step", 0);
    tandem_set_real(p, "rtol", 1e-10);
    before = qd[0] * qd[0] / 2 - bead_w * bead_w * pow(q[0], 4) / 4;
    tandem_start(p, 0, q, qd);
    tandem_integrate(p, 1);
    tandem_get_energies(p, &kinetic, NULL);
    tandem_get_state(p, NULL, q, qd, NULL);
    after = qd[0] * qd[0] / 2 - bead_w * bead_w * pow(q[0], 4) / 4;
    check("a-driven-motion-keeps-its-invariant", fabs(after - before) < 1e-8 && q[0] > 1.1, tandem_message(p));
    check("and-follows-its-drive", fabs(q[2] - bead_c * sin(1)) < 1e-12 && fabs(qd[1] - bead_w * q[0]) < 1e-12,
          "off the constraints");
    for (int i = 0; i < COUNTED; i++) check("each-function-of-it-is-called", calls[i] > 0, "a function is left out");
    tandem_set_motion_function(p, "kinetic_energy", NULL);
    tandem_start(p, 1, q, qd);
    tandem_get_energies(p, &by_mass, NULL);
    check("a-kinetic-energy-is-that-of-the-mass-matrix", fabs(kinetic - by_mass) < 1e-12, "another energy");
    tandem_free(p);
}

/* Every function that differences can be compared with, wrong in one entry. */
static void test_check(void)
{
    static const struct {
        const char *function, *word, *place;
        enum fault fault;
        int entry;
    } wrong[] = {{"holonomic", "holonomic_jacobian is wrong", "", NEGATE, 0},
                 {"holonomic_jacobian", "holonomic_jacobian is wrong by 0.1", "[0][2] (constraint \"bowl\") is 0.1250000,", OFF, 2},
                 {"nonholonomic_jacobian", "constraint_acceleration is wrong", "[1] (constraint \"nonholonomic 1\")", NEGATE, 1},
                 {"constraint_acceleration", "constraint_acceleration is wrong", "[0] (constraint \"bowl\")", NEGATE, 0},
                 {"constraint_acceleration", "constraint_acceleration gives NaN", "[1] (constraint", GIVE_NAN, 1},
                 {"mass_matrix", "mass_matrix is not symmetric", "[1] is 0", OFF, 6},
                 {"jacobian_derivative", "jacobian_derivative is wrong", "[1][3] (constraint", OFF, N + 3},
                 {"reaction_derivative", "reaction_derivative is wrong", "[1][0] is", OFF, N},
                 {"gamma_q", "gamma_q is wrong", "[0][1] (constraint", OFF, 1},
                 {"gamma_qd", "gamma_qd is wrong", "[1][0] (constraint", OFF, N},
                 {"force_q", "force_q is wrong", "[0][3] is 0.1250000, differences of the forces give", OFF, 3}};
    char name[100];
    double zero[N] = {0}, x[2 * N], y[2 * N], at = 0.25, value;

    for (unsigned i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        struct bowl b = new_bowl();
        tandem_problem *p = bowl_problem(&b);
        bowl_derivatives(p);
        tandem_set_row_name(p, 0, "bowl");
        if (i == 0) expect("right-functions-pass-the-check", p, tandem_check(p, 0, bowl_q, bowl_qd), TANDEM_OK, "ok");
        if (i == 0) expect("at-rest-too", p, tandem_check(p, 0, bowl_q, zero), TANDEM_OK, "ok");
        b.faulty = wrong[i].function;
        b.fault = wrong[i].fault;
        b.entry = wrong[i].entry;
        snprintf(name, sizeof name, "the-check-finds-a-wrong-%s", wrong[i].function);
        expect(name, p, tandem_check(p, 0, bowl_q, bowl_qd), TANDEM_INVALID_MODEL, wrong[i].word);
        snprintf(name, sizeof name, "and-where-in-%s", wrong[i].function);
        check(name, strstr(tandem_message(p), wrong[i].place) != NULL, tandem_message(p));
        tandem_free(p);
    }

    /* What the check is for: a run does not notice the sign of gamma, and says that its constraints hold. */
    struct bowl b = new_bowl(), plain = new_bowl();
    tandem_problem *p = bowl_problem_at_once(&b), *q;
    expect("a-function-of-all-terms-passes", p, tandem_check(p, 0, bowl_q, bowl_qd), TANDEM_OK, "ok");
    b.faulty = "constraint_acceleration";
    b.fault = NEGATE;
    tandem_start(p, 0, bowl_q, bowl_qd);
    expect("a-run-does-not-see-the-sign-of-gamma", p, tandem_integrate(p, 1), TANDEM_OK, "ok");
    expect("the-check-does", p, tandem_check(p, 0, bowl_q, bowl_qd), TANDEM_INVALID_MODEL,
           "constraint_acceleration is wrong by 2.");
    tandem_free(p);

    b = new_bowl();
    p = bowl_problem(&b);
    b.faulty = "applied_force";
    b.fault = RETRY;
    expect("what-cannot-be-evaluated-cannot-be-checked", p, tandem_check(p, 0, bowl_q, bowl_qd), TANDEM_NOT_EVALUABLE, "of force");
    b.fault = STOP;
    expect("nor-what-stops", p, tandem_check(p, 0, bowl_q, bowl_qd), TANDEM_CALLBACK_FAILED, "of force");
    bowl_derivatives(p);
    b.faulty = "gamma_q";
    expect("a-derivative-that-stops-is-named", p, tandem_check(p, 0, bowl_q, bowl_qd), TANDEM_CALLBACK_FAILED, "of gamma_q");
    b.faulty = NULL;
    expect("no-state-to-check", p, tandem_check(p, 0, bowl_q, NULL), TANDEM_INVALID_OPTION, "NULL");
    expect("nan-is-no-state", p, tandem_check(p, NAN, bowl_q, bowl_qd), TANDEM_INVALID_OPTION, "not finite");
    expect("a-check-is-no-start", p, tandem_step(p, 1), TANDEM_INVALID_OPTION, "tandem_start");
    tandem_set_position_function(p, "mass_matrix", NULL);
    expect("the-check-names-what-is-missing", p, tandem_check(p, 0, bowl_q, bowl_qd), TANDEM_INVALID_MODEL, "mass_matrix");
    tandem_free(p);
    p = tandem_new(4, 3, 2, NULL);
    expect("impossible-sizes-cannot-be-checked", p, tandem_check(p, 0, bowl_q, bowl_qd), TANDEM_INVALID_MODEL, "at most");
    tandem_free(p);

    /* In the middle of a run, which is in its second segment. */
    b = new_bowl();
    p = bowl_problem(&b);
    q = bowl_problem(&plain);
    tandem_set_vector(p, "breakpoints", 1, &at);
    tandem_set_vector(q, "breakpoints", 1, &at);
    tandem_start(p, 0, bowl_q, bowl_qd);
    tandem_start(q, 0, bowl_q, bowl_qd);
    tandem_integrate(p, 0.5);
    tandem_integrate(q, 0.5);
    expect("a-run-may-be-checked", p, tandem_check(p, 0, bowl_q, bowl_qd), TANDEM_OK, "ok");
    check("and-keeps-its-segment", tandem_get_segment(p) == 2, "another one");
    tandem_integrate(p, 1);
    tandem_integrate(q, 1);
    tandem_get_state(p, NULL, x, x + N, NULL);
    tandem_get_state(q, NULL, y, y + N, NULL);
    tandem_get_statistic(p, "steps", &value);
    check("and-goes-on-as-if-nothing-had-been", memcmp(x, y, sizeof x) == 0 && value > 90, tandem_message(p));
    tandem_free(p);
    tandem_free(q);
}

static void test_missing(void)
{
    static const char *const position[] = {"holonomic", "holonomic_jacobian", "nonholonomic_jacobian", "mass_matrix"};
    char name[80];
    for (int i = 0; i < 4; i++) {
        struct bowl b = new_bowl();
        tandem_problem *p = bowl_problem(&b);
        tandem_set_position_function(p, position[i], NULL);
        sprintf(name, "missing-%s-is-named", position[i]);
        expect(name, p, tandem_start(p, 0, bowl_q, bowl_qd), TANDEM_INVALID_MODEL, position[i]);
        tandem_free(p);
    }
    struct bowl b = new_bowl();
    tandem_problem *p = bowl_problem(&b);
    double x[2 * N];
    tandem_set_motion_function(p, "constraint_acceleration", NULL);
    run_to(p, 1, x);
    expect("a-missing-gamma-is-no-failure", p, x[0] == 0, 0, "ok");
    tandem_free(p);
    p = tandem_new(N, NH, ND, NULL);
    expect("a-missing-evaluate-is-named", p, tandem_start(p, 0, bowl_q, bowl_qd), TANDEM_INVALID_MODEL, "missing");
    tandem_free(p);
}

static void test_sizes(void)
{
    static const int sizes[][3] = {{0, 0, 0},       {-1, 0, 0},           {4, -1, 0},           {4, 0, -1},
                                   {4, 3, 2},       {INT_MAX, 1, 1},      {INT_MIN, 1, 1},      {4, INT_MAX, INT_MAX},
                                   {4, INT_MIN, 1}, {4, INT_MIN, INT_MIN}, {4, INT_MAX, INT_MIN}};
    char name[80];
    for (unsigned i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        struct bowl b = new_bowl();
        tandem_problem *p = tandem_new(sizes[i][0], sizes[i][1], sizes[i][2], &b);
        sprintf(name, "impossible-sizes-%u-are-told", i + 1);
        check(name, strstr(tandem_message(p), "invalid_model") != NULL, tandem_message(p));
        tandem_set_evaluate(p, bowl_evaluate, TANDEM_PHI | TANDEM_JACOBIAN | TANDEM_GAMMA | TANDEM_MASS | TANDEM_FORCE);
        sprintf(name, "impossible-sizes-%u-are-refused", i + 1);
        expect(name, p, tandem_start(p, 0, bowl_q, bowl_qd), TANDEM_INVALID_MODEL, "invalid_model");
        tandem_set_row_name(p, 0, "row");
        tandem_free(p);
    }
}

static void test_faults(void)
{
    static const char *const functions[] = {"holonomic",   "holonomic_jacobian", "nonholonomic_jacobian",
                                            "mass_matrix", "applied_force",      "constraint_acceleration",
                                            "evaluate"};
    static const struct {
        enum fault fault;
        const char *name;
        int status;
    } faults[] = {{RETRY, "that-cannot-be-evaluated", TANDEM_NOT_EVALUABLE},
                  {STOP, "that-stops", TANDEM_CALLBACK_FAILED},
                  {GIVE_NAN, "that-gives-nan", TANDEM_NOT_FINITE},
                  {GIVE_INFINITY, "that-gives-infinity", TANDEM_NOT_FINITE}};
    char name[160];
    for (int i = 0; i < 7; i++) {
        for (int j = 0; j < 4; j++) {
            struct bowl b = new_bowl();
            tandem_problem *p = i < 6 ? bowl_problem(&b) : bowl_problem_at_once(&b);
            double t;
            int status;
            b.faulty = functions[i];
            b.fault = faults[j].fault;
            sprintf(name, "%s-%s-at-the-start", functions[i], faults[j].name);
            expect(name, p, tandem_start(p, 0, bowl_q, bowl_qd), faults[j].status, "at the start");
            b.fault_at = 0.5;
            b.last_t = 0;
            sprintf(name, "%s-%s-in-a-step", functions[i], faults[j].name);
            status = tandem_start(p, 0, bowl_q, bowl_qd);
            if (status == TANDEM_OK) status = tandem_integrate(p, 1);
            expect(name, p, status, faults[j].status, " t = ");
            tandem_get_state(p, &t, NULL, NULL, NULL);
            check("the-state-before-the-failure-is-kept", t > 0.48 && t <= 0.5, tandem_message(p));
            tandem_free(p);
        }
    }
    /* Error control takes smaller steps up to where a point cannot be evaluated, and ends there. */
    struct bowl b = new_bowl();
    tandem_problem *p = bowl_problem(&b);
    double t;
    tandem_set_text(p, "stepper", "dopri5");
    tandem_set_real(p, "step", 0);
    tandem_set_real(p, "rtol", 1e-6);
    b.faulty = "applied_force";
    b.fault = RETRY;
    b.fault_at = 0.5;
    tandem_start(p, 0, bowl_q, bowl_qd);
    expect("error-control-ends-at-a-wall", p, tandem_integrate(p, 1), TANDEM_NOT_EVALUABLE, "smallest step");
    tandem_get_state(p, &t, NULL, NULL, NULL);
    check("error-control-comes-near-the-wall", t > 0.4999 && t < 0.5, "far from it");
    tandem_free(p);

    b = new_bowl();
    p = bowl_problem(&b);
    b.faulty = "applied_force";
    b.fault = CALL_BACK;
    tandem_start(p, 0, bowl_q, bowl_qd);
    check("a-function-may-not-use-its-problem", b.status_of_call_back == TANDEM_INVALID_OPTION, tandem_message(p));
    b.fault = FREE;
    tandem_start(p, 0, bowl_q, bowl_qd);
    expect("a-function-cannot-free-its-problem", p, tandem_integrate(p, 0.1), TANDEM_OK, "ok");
    tandem_free(p);
}

/* A mass on a spring and a damper that are far stiffer than its motion, q = sin(t). */
static int of_one(double t, const double *q, double *value, void *user_data)
{
    (void)t, (void)q, (void)user_data;
    value[0] = 1;
    return 0;
}

static int of_stiff_spring(double t, const double *q, const double *qd, double *value, void *user_data)
{
    (void)user_data;
    value[0] = -1e8 * (q[0] - sin(t)) - 2e4 * (qd[0] - cos(t)) - sin(t);
    return 0;
}

/* `auto` finds out that this is stiff, and says so in its figures. */
static void test_auto(void)
{
    tandem_problem *p = tandem_new(1, 0, 0, NULL);
    double q = 0, qd = 1, t, switches, steps;

    tandem_set_position_function(p, "mass_matrix", of_one);
    tandem_set_motion_function(p, "applied_force", of_stiff_spring);
    expect("auto-is-taken", p, tandem_set_text(p, "stepper", "auto"), TANDEM_OK, "ok");
    tandem_set_real(p, "step", 1e-3);
    tandem_set_real(p, "rtol", 1e-6);
    expect("step-or-rtol", p, tandem_start(p, 0, &q, &qd), TANDEM_INVALID_OPTION, "remove step or rtol");
    tandem_set_real(p, "step", 0);
    tandem_set_real(p, "rtol", 0);
    expect("auto-has-a-tolerance", p, tandem_start(p, 0, &q, &qd), TANDEM_OK, "ok");
    tandem_set_real(p, "rtol", 1e-6);
    tandem_start(p, 0, &q, &qd);
    expect("auto-runs", p, tandem_integrate(p, 2), TANDEM_OK, "ok");
    tandem_get_state(p, &t, &q, &qd, NULL);
    check("auto-is-right", fabs(q - sin(2)) < 1e-5 && fabs(qd - cos(2)) < 1e-5, "another motion");
    tandem_get_statistic(p, "switches", &switches);
    tandem_get_statistic(p, "steps", &steps);
    /* dop853 alone would need some 1e4/6 steps a second. */
    check("auto-goes-over-to-radau5", switches >= 1 && steps < 1000, "it does not");
    tandem_free(p);
}

static void test_saved(void)
{
    static const char *const steppers[] = {"rk4", "dop853", "radau5", "auto", "sdirk54"};
    static int64_t words[20000];
    double x[2 * N], y[2 * N], start[N] = {0.4, 0.1, 0.2, 0}, rate[N] = {0, 0, 1, 0}, kink = 0.5;
    char name[60];
    int count, again;

    for (int i = 0; i < 5; i++) {
        struct bowl b = new_bowl(), other = new_bowl();
        tandem_problem *p = bowl_problem(&b), *q = bowl_problem(&other);
        tandem_set_text(p, "stepper", steppers[i]);
        tandem_set_text(q, "stepper", steppers[i]);
        if (i > 0) {
            tandem_set_real(p, "step", 0);
            tandem_set_real(p, "rtol", 1e-6);
            tandem_set_real(q, "step", 0);
            tandem_set_real(q, "rtol", 1e-6);
        }
        run_to(p, 1, x);
        snprintf(name, sizeof name, "%s-is-saved", steppers[i]);
        int status = tandem_save_state(p, 0, NULL, &count);
        check(name, status == 0 && count > 0 && count < 20000 && tandem_save_state(p, count, words, &again) == 0 && again == count,
              tandem_message(p));
        tandem_integrate(p, 2);
        tandem_get_state(p, NULL, x, x + N, NULL);
        /* From another start. */
        start[3] = b.k * (start[0] * start[0] + start[1] * start[1]) / 2;
        tandem_start(q, 0.5, start, rate);
        snprintf(name, sizeof name, "%s-goes-on-from-there", steppers[i]);
        status = tandem_restore_state(q, count, words);
        check(name, status == 0 && tandem_integrate(q, 2) == 0, tandem_message(q));
        tandem_get_state(q, NULL, y, y + N, NULL);
        snprintf(name, sizeof name, "%s-bitwise-as-if-nothing-had-been", steppers[i]);
        check(name, memcmp(x, y, sizeof x) == 0, "another motion");
        tandem_free(p);
        tandem_free(q);
    }

    struct bowl b = new_bowl();
    tandem_problem *p = bowl_problem(&b);
    expect("nothing-to-save-before-the-start", p, tandem_save_state(p, 20000, words, &again), TANDEM_INVALID_OPTION,
           "tandem_start");
    check("and-it-counts-nothing", again == 0, "not zero");
    expect("nor-to-restore", p, tandem_restore_state(p, count, words), TANDEM_INVALID_OPTION, "tandem_start");
    tandem_start(p, 0, bowl_q, bowl_qd);
    expect("no-room-for-the-state", p, tandem_save_state(p, 10, words, &again), TANDEM_INVALID_OPTION, "capacity is 10");
    expect("nowhere-to-save", p, tandem_save_state(p, 10, NULL, NULL), TANDEM_INVALID_OPTION, "NULL");
    expect("no-saved-state", p, tandem_restore_state(p, 10, NULL), TANDEM_INVALID_OPTION, "NULL");
    expect("state-of-another-run", p, tandem_restore_state(p, count, words), TANDEM_INVALID_CHECKPOINT, "stepper");
    expect("then-it-must-be-started", p, tandem_step(p, 1), TANDEM_INVALID_OPTION, "tandem_start");
    tandem_set_text(p, "stepper", "sdirk54");
    tandem_set_real(p, "step", 0);
    tandem_set_real(p, "rtol", 1e-6);
    tandem_set_vector(p, "breakpoints", 1, &kink);
    tandem_start(p, 0, bowl_q, bowl_qd);
    expect("state-with-other-breakpoints", p, tandem_restore_state(p, count, words), TANDEM_INVALID_CHECKPOINT, "breakpoints");
    tandem_start(p, 0, bowl_q, bowl_qd);
    words[count / 2] ^= 4;
    expect("damaged-state", p, tandem_restore_state(p, count, words), TANDEM_INVALID_CHECKPOINT, "damaged");
    tandem_free(p);
}

static void test_mass_blocks(void)
{
    struct bowl b = new_bowl(), whole = new_bowl();
    tandem_problem *p = bowl_problem(&b), *q = bowl_problem(&whole);
    double x[2 * N], y[2 * N], off = 0;
    static double many[131077];
    const double sizes[] = {1, 1, 2}, half[] = {1, 1.5, 1.5}, few[] = {1, 2};

    run_to(q, 1, y);
    tandem_set_vector(p, "mass_blocks", 3, sizes);
    run_to(p, 1, x);
    for (int i = 0; i < 2 * N; i++) off = fmax(off, fabs(x[i] - y[i]));
    check("blocks-of-the-mass-change-nothing", off < 1e-13, tandem_message(p));
    expect("half-a-block", p, tandem_set_vector(p, "mass_blocks", 3, half), TANDEM_INVALID_OPTION, "positive integers");
    tandem_set_vector(p, "mass_blocks", 2, few);
    expect("too-few-blocks", p, tandem_start(p, 0, bowl_q, bowl_qd), TANDEM_INVALID_MODEL, "mass_blocks");
    for (int i = 0; i < 131077; i++) many[i] = i < 131076 ? 32767 : 8;
    tandem_set_vector(p, "mass_blocks", 131077, many);
    /* Their sum is 2^32 + 4. */
    expect("blocks-beyond-all-integers", p, tandem_start(p, 0, bowl_q, bowl_qd), TANDEM_INVALID_MODEL, "mass_blocks");
    tandem_set_vector(p, "mass_blocks", 0, NULL);
    expect("and-none-again", p, tandem_start(p, 0, bowl_q, bowl_qd), TANDEM_OK, "ok");
    tandem_free(p);
    tandem_free(q);
}

/* The address may be handed over before the call that the text is of, as in printf("%d %s", call, tandem_message(p)). */
static void test_message(void)
{
    struct bowl b = new_bowl();
    tandem_problem *p = bowl_problem(&b);
    const char *told = tandem_message(p);
    char name[256], row[40];

    check("the-message-of-a-new-problem-is-ok", strncmp(told, "ok", 2) == 0, told);
    memset(name, 'x', sizeof name);
    name[sizeof name - 1] = 0;
    tandem_set_real(p, name, 1);
    check("a-long-message-is-at-the-same-place", tandem_message(p) == told && strstr(told, "rtol") != NULL, told);
    tandem_set_row_name(p, 0, "bowl");
    check("a-short-one-leaves-nothing-of-it", tandem_message(p) == told && strcmp(told, "ok: success") == 0, told);
    tandem_start(p, 0, bowl_q, bowl_qd);
    snprintf(row, sizeof row, "%d %s", tandem_step(p, -1), told);
    check("and-is-that-of-the-call-beside-it", tandem_message(p) == told && strstr(told, "after the current time") != NULL, row);
    check("null-has-a-message-at-one-place", tandem_message(NULL) == tandem_message(NULL), tandem_message(NULL));
    tandem_free(p);
}

/* Which calls end a run that is under way, and which do not. */
static void test_changes(void)
{
    struct bowl b = new_bowl();
    tandem_problem *p = bowl_problem(&b);
    double one = 1, half = 0.5;

    tandem_start(p, 0, bowl_q, bowl_qd);
    tandem_set_real(p, "step", 1e-3);
    tandem_set_integer(p, "max_steps", 5);
    tandem_set_text(p, "stepper", "trapezoid");
    tandem_set_row_name(p, 0, "bowl");
    tandem_check(p, 0, bowl_q, bowl_qd);
    expect("options-and-names-end-no-run", p, tandem_integrate(p, 1), TANDEM_OK, "ok");
    tandem_get_statistic(p, "steps", &one);
    check("and-count-from-the-next-start", one == 100, "other steps");
    tandem_set_position_function(p, "phi", bowl_phi);
    tandem_set_motion_function(p, "gamma", bowl_gamma);
    tandem_set_direction_function(p, "gamma", bowl_c2);
    tandem_set_evaluate(p, bowl_evaluate, 64);
    tandem_set_integer(p, "constant_masses", 1);
    tandem_set_vector(p, "scale", 1, &one);
    tandem_set_vector(p, "breakpoints", 1, NULL);
    tandem_set_vector(p, "mass_blocks", 1, &half);
    expect("a-change-that-is-refused-ends-no-run", p, tandem_integrate(p, 2), TANDEM_OK, "ok");

    tandem_set_integer(p, "max_steps", 1000);
    for (int i = 0; i < 4; i++) {
        static const char *const names[] = {"a-list", "constant-mass", "a-potential-energy", "an-evaluate"};
        char name[60];
        tandem_start(p, 0, bowl_q, bowl_qd);
        if (i == 0) tandem_set_vector(p, "breakpoints", 1, &one);
        if (i == 1) tandem_set_integer(p, "constant_mass", 1);
        if (i == 2) tandem_set_position_function(p, "potential_energy", bowl_potential);
        if (i == 3) tandem_set_evaluate(p, NULL, 0);
        snprintf(name, sizeof name, "%s-ends-a-run", names[i]);
        expect(name, p, tandem_step(p, 1), TANDEM_INVALID_OPTION, "created or changed");
    }
    tandem_free(p);
}

/* A value that cannot be is refused at once, and the one before stays. */
static void test_values(void)
{
    static const char *const words[] = {"stepper", "chart", "refresh", "basis", "projection"};
    struct bowl b = new_bowl();
    tandem_problem *p = bowl_problem(&b);
    char name[60];
    double steps;

    for (int i = 0; i < 5; i++) {
        snprintf(name, sizeof name, "nonsense-is-no-%s", words[i]);
        expect(name, p, tandem_set_text(p, words[i], "nonsense"), TANDEM_INVALID_OPTION, "\"nonsense\" is unknown; use ");
        snprintf(name, sizeof name, "null-is-no-%s", words[i]);
        expect(name, p, tandem_set_text(p, words[i], NULL), TANDEM_INVALID_OPTION, "NULL");
    }
    expect("a-step-is-positive", p, tandem_set_real(p, "step", -5), TANDEM_INVALID_OPTION, "step = -5");
    expect("and-a-number", p, tandem_set_real(p, "step", NAN), TANDEM_INVALID_OPTION, "step = NaN");
    expect("a-tolerance-is-below-one", p, tandem_set_real(p, "rtol", 2), TANDEM_INVALID_OPTION, "rtol = 2");
    expect("no-run-of-no-steps", p, tandem_set_integer(p, "max_steps", 0), TANDEM_INVALID_OPTION, "max_steps = 0");
    expect("what-was-refused-changes-nothing", p, tandem_start(p, 0, bowl_q, bowl_qd), TANDEM_OK, "ok");
    tandem_integrate(p, 1);
    tandem_get_statistic(p, "steps", &steps);
    check("and-the-values-before-stay", steps == 100, "other steps");
    tandem_free(p);
}

/* Every call with a handle that was given back. */
static void test_given_back(void)
{
    struct bowl b = new_bowl();
    tandem_problem *p = bowl_problem(&b), *q;
    double x[N];

    tandem_start(p, 0, bowl_q, bowl_qd);
    tandem_free(p);
    q = bowl_problem(&b); /* and another one may take its place in memory */
    int status = tandem_set_position_function(p, "holonomic", bowl_phi) + tandem_set_motion_function(p, "gamma_q", NULL) +
                 tandem_set_direction_function(p, "mass_derivative", NULL) + tandem_set_evaluate(p, NULL, 1) +
                 tandem_set_row_name(p, 0, "row") + tandem_set_real(p, "step", 1) + tandem_set_integer(p, "max_steps", 1) +
                 tandem_set_text(p, "stepper", "rk4") + tandem_set_vector(p, "breakpoints", 0, NULL) +
                 tandem_check(p, 0, x, x) + tandem_start(p, 0, x, x) + tandem_integrate(p, 1) + tandem_step(p, 1) +
                 tandem_get_state(p, x, x, x, x) + tandem_get_state_at(p, 0, x, x, x) + tandem_get_multipliers(p, 0, x) +
                 tandem_get_energies(p, x, x) + tandem_get_statistic(p, "steps", x) + tandem_save_state(p, 0, NULL, NULL) +
                 tandem_restore_state(p, 0, NULL) + tandem_count_warnings(p, NULL) + tandem_get_warning(p, 0, 0, NULL);
    check("a-handle-given-back-is-refused-everywhere", status == 22 * TANDEM_INVALID_OPTION && tandem_get_segment(p) == 0,
          "not by all");
    check("and-has-a-message", strstr(tandem_message(p), "handle") != NULL, tandem_message(p));
    tandem_free(p);
    expect("another-problem-does-not-notice", q, tandem_start(q, 0, bowl_q, bowl_qd), TANDEM_OK, "ok");
    tandem_free(q);
}

/* The bowl with rows in other units. */
static double unit;

static int unit_phi(double t, const double *q, double *value, void *user_data)
{
    int status = bowl_phi(t, q, value, user_data);
    value[0] *= unit;
    return status;
}

/* As it might be written where q is given in such units: squares overflow. */
static int overflowing_phi(double t, const double *q, double *value, void *user_data)
{
    int status = bowl_phi(t, q, value, user_data);
    value[0] = (value[0] + 1) * unit * unit / unit - unit * unit / unit;
    return status;
}

static int unit_phi_q(double t, const double *q, double *value, void *user_data)
{
    int status = bowl_phi_q(t, q, value, user_data);
    for (int i = 0; i < N; i++) value[i] *= unit;
    return status;
}

static int unit_e(double t, const double *q, double *value, void *user_data)
{
    int status = bowl_e(t, q, value, user_data);
    for (int i = 0; i < N; i++) value[i] *= unit;
    return status;
}

static int unit_gamma(double t, const double *q, const double *qd, double *value, void *user_data)
{
    int status = bowl_gamma(t, q, qd, value, user_data);
    for (int i = 0; i < NC; i++) value[i] *= unit;
    return status;
}

static void test_units(void)
{
    static const double units[] = {1e-200, 1e-30, 1e30, 1e200};
    char name[60];

    for (int i = 0; i < 4; i++) {
        struct bowl b = new_bowl();
        tandem_problem *p = bowl_problem(&b);
        unit = units[i];
        tandem_set_position_function(p, "holonomic", unit_phi);
        tandem_set_position_function(p, "holonomic_jacobian", unit_phi_q);
        tandem_set_position_function(p, "nonholonomic_jacobian", unit_e);
        tandem_set_motion_function(p, "constraint_acceleration", unit_gamma);
        snprintf(name, sizeof name, "rows-in-units-of-%g-pass-the-check", 1 / unit);
        expect(name, p, tandem_check(p, 0.3, bowl_q, bowl_qd), TANDEM_OK, "ok");
        b.faulty = "constraint_acceleration";
        b.fault = NEGATE;
        snprintf(name, sizeof name, "wrong-rows-in-units-of-%g-do-not", 1 / unit);
        expect(name, p, tandem_check(p, 0.3, bowl_q, bowl_qd), TANDEM_INVALID_MODEL, "constraint_acceleration is wrong by 2.");
        b.faulty = "holonomic_jacobian";
        snprintf(name, sizeof name, "nor-does-a-jacobian-in-units-of-%g", 1 / unit);
        expect(name, p, tandem_check(p, 0.3, bowl_q, bowl_qd), TANDEM_INVALID_MODEL, "holonomic_jacobian is wrong by 0.");
        b.faulty = NULL;
        tandem_set_position_function(p, "holonomic", overflowing_phi);
        snprintf(name, sizeof name, "what-overflows-in-units-of-%g-is-blamed", 1 / unit);
        if (unit > 1e100) expect(name, p, tandem_check(p, 0.3, bowl_q, bowl_qd), TANDEM_INVALID_MODEL,
                                 "cannot be compared: differences of holonomic give NaN");
        tandem_free(p);
    }
}

/* A function that returns 0 and has set nothing, or not all: what ctypes makes of an exception in Python. */
static int leave_position(double t, const double *q, double *value, void *user_data)
{
    struct bowl *b = user_data;
    (void)t, (void)q;
    for (int i = 0; i < b->entry; i++) value[i] = 1;
    return 0;
}

static int leave_motion(double t, const double *q, const double *qd, double *value, void *user_data)
{
    (void)qd;
    return leave_position(t, q, value, user_data);
}

static int leave_all(int need, double t, const double *q, const double *qd, double *phi, double *jacobian, double *nu,
                     double *gamma, double *mass, double *force, void *user_data)
{
    (void)need, (void)t, (void)q, (void)qd, (void)phi, (void)jacobian, (void)nu, (void)gamma, (void)mass, (void)force;
    (void)user_data;
    return 0;
}

static void test_unset(void)
{
    static const struct {
        const char *function, *word;
        int entries;
    } unset[] = {{"holonomic", "term phi", 1},
                 {"holonomic_jacobian", "term jacobian", N},
                 {"nonholonomic_jacobian", "term jacobian", N},
                 {"mass_matrix", "term mass", N * N},
                 {"constraint_acceleration", "term gamma", NC},
                 {"applied_force", "term force", N}};
    char name[80];

    for (int i = 0; i < 6; i++) {
        for (int some = 0; some < 2 && (some == 0 || unset[i].entries > 1); some++) {
            struct bowl b = new_bowl();
            tandem_problem *p = bowl_problem(&b);
            b.entry = some ? unset[i].entries - 1 : 0;
            if (i < 4) tandem_set_position_function(p, unset[i].function, leave_position);
            else tandem_set_motion_function(p, unset[i].function, leave_motion);
            snprintf(name, sizeof name, "%s-that-sets-%s-is-named", unset[i].function, some ? "not-all" : "nothing");
            expect(name, p, tandem_start(p, 0, bowl_q, bowl_qd), TANDEM_CALLBACK_FAILED, unset[i].word);
            tandem_free(p);
        }
    }
    struct bowl b = new_bowl();
    tandem_problem *p = bowl_problem_at_once(&b);
    tandem_set_evaluate(p, leave_all, TANDEM_PHI | TANDEM_JACOBIAN | TANDEM_GAMMA | TANDEM_MASS | TANDEM_FORCE);
    expect("an-evaluate-that-sets-nothing-is-named", p, tandem_start(p, 0, bowl_q, bowl_qd), TANDEM_CALLBACK_FAILED, "evaluate");
    tandem_free(p);
    p = bowl_problem(&b);
    b.entry = 0;
    tandem_set_position_function(p, "potential_energy", leave_position);
    tandem_start(p, 0, bowl_q, bowl_qd);
    expect("an-energy-that-sets-nothing-is-a-failure", p, tandem_get_energies(p, NULL, NULL), TANDEM_CALLBACK_FAILED, "energy");
    tandem_free(p);
}

/* What to do is what can be done from here. */
static void test_advice(void)
{
    struct bowl b = new_bowl();
    tandem_problem *p = bowl_problem(&b);
    double wrong[N] = {1, 0, 0.5, 0.3};

    tandem_start(p, 0, wrong, bowl_qd);
    check("a-start-is-assembled-by-its-function", strstr(tandem_message(p), "give q and qd that satisfy") != NULL &&
          strstr(tandem_message(p), "or move them by tandem_assemble") != NULL, tandem_message(p));
    tandem_set_position_function(p, "mass_matrix", NULL);
    tandem_start(p, 0, bowl_q, bowl_qd);
    check("a-function-is-given-by-its-setter", strstr(tandem_message(p), "tandem_set_position_function") != NULL &&
          strstr(tandem_message(p), "associate") == NULL, tandem_message(p));
    tandem_set_motion_function(p, "applied_force", NULL);
    tandem_set_position_function(p, "mass_matrix", bowl_mass);
    tandem_start(p, 0, bowl_q, bowl_qd);
    expect("a-run-is-started-by-tandem-start", p, tandem_set_motion_function(p, "applied_force", bowl_force) + tandem_step(p, 1),
           TANDEM_INVALID_OPTION, "call tandem_start first");
    tandem_free(p);
}

static int cart_mass(double t, const double *q, double *value, void *user_data)
{
    (void)t, (void)q, (void)user_data;
    value[0] = 2;
    return 0;
}

static int cart_force(double t, const double *q, const double *qd, double *value, void *user_data)
{
    (void)t, (void)user_data;
    value[0] = -18 * (q[0] - 1) - 0.8 * qd[0];
    return 0;
}

/* A cart on a damped spring: 2 l^2 + 0.8 l + 18 = 0, by differences of fourth order. */
static void test_linearised(void)
{
    tandem_problem *p = tandem_new(1, 0, 0, NULL);
    double q = 0.3, zero = 0, re[2], im[2], a[4];
    int count = -1;

    tandem_set_position_function(p, "mass_matrix", cart_mass);
    tandem_set_motion_function(p, "applied_force", cart_force);
    expect("an-equilibrium-is-found", p, tandem_find_equilibrium(p, 0, &q), TANDEM_OK, "ok");
    check("where-the-spring-is-loose", fabs(q - 1) < 1e-12, "the equilibrium is elsewhere");
    expect("a-model-is-linearised", p, tandem_linearise(p, 0, &q, &zero, &count, re, im, a), TANDEM_OK, "ok");
    check("two-eigenvalues", count == 2 && fabs(re[0] + 0.2) < 1e-9 && fabs(re[1] + 0.2) < 1e-9 && fabs(im[0] + sqrt(8.96)) < 1e-9 &&
              fabs(im[1] - sqrt(8.96)) < 1e-9, "they are others");
    check("the-matrix-by-columns", fabs(a[0]) < 1e-12 && fabs(a[2] - 1) < 1e-12 && fabs(a[1] + 9) < 1e-8 && fabs(a[3] + 0.4) < 1e-8,
          "it is another");
    expect("the-matrix-may-be-left-out", p, tandem_linearise(p, 0, &q, &zero, &count, re, im, NULL), TANDEM_OK, "ok");
    expect("eigenvalues-may-not", p, tandem_linearise(p, 0, &q, &zero, &count, NULL, im, a), TANDEM_INVALID_OPTION, "NULL");
    expect("nor-a-place", p, tandem_find_equilibrium(p, 0, NULL), TANDEM_INVALID_OPTION, "NULL");
    tandem_free(p);
}

/* A function of an event of a mechanism: where the rod hangs. */
static int hanging(double t, const double *q, const double *qd, double *value, void *user_data)
{
    (void)t;
    (void)qd;
    ++*(int *)user_data;
    *value = q[0];
    return 0;
}

/* A rod that swings from the horizontal, by keys: a pendulum of the reduced length 2/3. */
static void test_mechanism(void)
{
    int calls = 0, n = -1, nh = -1, nd = -1, event = -2;
    tandem_problem *p = tandem_new_mechanism(&calls);
    double q[3] = {0, 0, 0}, qd[3], t, lambda[2];
    char name[40];

    expect("a-mechanism-has-no-sizes-yet", p, tandem_get_sizes(p, &n, &nh, &nd), TANDEM_OK, "ok");
    check("which-are-zero", n == 0 && nh == 0 && nd == 0, "they are others");
    expect("nor-a-start", p, tandem_start(p, 0, q, qd), TANDEM_INVALID_MODEL, "not complete");
    expect("nor-a-drawing", p, tandem_get_drawing(p, q, qd), TANDEM_INVALID_OPTION, "tandem_define");
    expect("nor-an-equilibrium", p, tandem_find_equilibrium(p, 0, q), TANDEM_INVALID_MODEL, "not complete");
    expect("nor-a-run-that-advances", p, tandem_advance(p, 1, 10, 1, 0, &t, q, qd, NULL, &n), TANDEM_INVALID_OPTION, "no run");
    expect("nor-a-watched-entry", p, tandem_add_event(p, "down", "q", 0, 0, 0, 1), TANDEM_INVALID_OPTION, "0 entries");
    tandem_set_key(p, "gravity.vector", "[0, -9.81]");
    tandem_set_key(p, "parameters.l", "1.0");
    tandem_set_key(p, "body.rod.inertia", "\"l^2/12\"");
    tandem_set_key(p, "body.rod.position", "[ \"l/2\", 0 ]");
    tandem_set_key(p, "joint.pivot.type", "\"revolute\"");
    tandem_set_key(p, "joint.pivot.bodies", "[\"ground\", \"rod\"]");
    tandem_set_key(p, "joint.pivot.at", "[0, 0]");
    expect("a-key-is-missing", p, tandem_define(p, 1, 0, 0, 10), TANDEM_INVALID_MODEL, "mass");
    expect("a-value-that-is-none", p, tandem_set_key(p, "body.rod.mass", "1 kg"), TANDEM_INVALID_OPTION, "1 kg");
    expect("a-sum-that-is-no-number", p, tandem_set_key(p, "body.rod.mass", "1+2"), TANDEM_INVALID_OPTION, "1+2");
    expect("nor-a-difference-in-a-list", p, tandem_set_key(p, "gravity.vector", "[0, 1-5]"), TANDEM_INVALID_OPTION, "1-5");
    expect("a-number-with-an-exponent", p, tandem_set_key(p, "parameters.l", "+1.0E+0"), TANDEM_OK, "ok");
    expect("no-value", p, tandem_set_key(p, "body.rod.mass", NULL), TANDEM_INVALID_OPTION, "body.rod.mass");
    expect("no-key", p, tandem_set_key(p, NULL, "1"), TANDEM_INVALID_OPTION, "key");
    tandem_set_key(p, "body.rod.mass", "1.0");
    expect("then-it-can-be-mended", p, tandem_define(p, 1, 0, 0, 10), TANDEM_OK, "ok");
    expect("once", p, tandem_define(p, 1, 0, 0, 10), TANDEM_INVALID_OPTION, "complete");
    tandem_get_sizes(p, &n, &nh, &nd);
    check("a-rod-on-a-pivot", n == 3 && nh == 2 && nd == 0, "it has other sizes");
    tandem_get_name(p, "coordinate", 2, sizeof name, name);
    check("coordinates-have-names", strcmp(name, "rod.angle") == 0, name);
    tandem_get_name(p, "unit", 0, sizeof name, name);
    check("and-units", strcmp(name, "m") == 0, name);
    tandem_get_name(p, "row", 1, 4, name);
    check("names-are-cut-where-there-is-no-room", strcmp(name, "piv") == 0, name);
    expect("no-fourth-coordinate", p, tandem_get_name(p, "coordinate", 3, sizeof name, name), TANDEM_INVALID_OPTION, "no such");
    expect("no-other-names", p, tandem_get_name(p, "body", 0, sizeof name, name), TANDEM_INVALID_OPTION, "row");
    expect("no-room", p, tandem_get_name(p, "row", 0, 0, name), TANDEM_INVALID_OPTION, "capacity");
    expect("no-functions-of-the-caller", p, tandem_set_position_function(p, "mass_matrix", cart_mass), TANDEM_INVALID_OPTION, "keys");
    expect("no-check-of-them", p, tandem_check(p, 0, q, qd), TANDEM_INVALID_OPTION, "keys");
    expect("the-drawing", p, tandem_get_drawing(p, q, qd), TANDEM_OK, "ok");
    check("is-where-it-was-drawn", q[0] == 0.5 && q[1] == 0 && q[2] == 0 && qd[0] == 0 && qd[1] == 0 && qd[2] == 0, "it is not");
    tandem_set_text(p, "stepper", "dop853");
    tandem_set_real(p, "step", 0);
    tandem_set_real(p, "rtol", 1e-10);
    expect("events-have-functions", p, tandem_add_event_function(p, "hanging", hanging, -1, 1), TANDEM_OK, "ok");
    expect("it-starts", p, tandem_start(p, 0, q, qd), TANDEM_OK, "ok");
    expect("and-swings", p, tandem_integrate(p, 10), TANDEM_OK, "ok");
    tandem_get_stop(p, &event);
    tandem_get_state(p, &t, q, qd, NULL);
    /* K(sin(pi/4)) sqrt(2/(3 g)), and the energy m g/2 at the lowest place. */
    check("to-where-it-hangs", event == 0 && calls > 0 && fabs(t - 1.8540746773013719 * sqrt(2 / (3 * 9.81))) < 1e-8, "at another time");
    check("at-the-speed-of-its-fall", fabs(qd[2] + sqrt(3 * 9.81)) < 1e-7, "at another speed");
    tandem_get_multipliers(p, t, lambda);
    /* Weight and centripetal force, (1 + 3/2) m g, at the pivot. */
    check("the-pivot-carries-it", fabs(fabs(lambda[1]) - 2.5 * 9.81) < 1e-6, "another force");
    tandem_free(p);
    p = tandem_new(1, 0, 0, NULL);
    expect("keys-are-of-mechanisms", p, tandem_set_key(p, "body.rod.mass", "1"), TANDEM_INVALID_OPTION, "tandem_new_mechanism");
    expect("so-is-the-drawing", p, tandem_get_drawing(p, q, qd), TANDEM_INVALID_OPTION, "tandem_define");
    tandem_free(p);
    p = tandem_new_mechanism(NULL);
    tandem_free(p);

    /* A drawing whose joint does not meet: what is advised is what can be done from here. */
    p = tandem_new_mechanism(NULL);
    tandem_set_key(p, "body.rod.mass", "1");
    tandem_set_key(p, "body.rod.inertia", "1");
    tandem_set_key(p, "body.rod.position", "[0, 0]");
    tandem_set_key(p, "joint.pin.type", "\"revolute\"");
    tandem_set_key(p, "joint.pin.bodies", "[\"ground:[0, 0]\", \"rod:[1, 0]\"]");
    expect("an-open-joint", p, tandem_define(p, 1, 0, 0, 10), TANDEM_INVALID_MODEL, "open in tandem_define and call tandem_assemble");
    check("without-a-word-on-scenes", strstr(tandem_message(p), "[initial]") == NULL, tandem_message(p));
    tandem_free(p);
}

/* A bob on a string of 1 m that turns about the vertical: g = w^2 h at the height h below the pivot. */
static void test_steady_motion(void)
{
    tandem_problem *p = tandem_new_mechanism(NULL);
    double q[3], qd[3], h = 9.81 / 16, r = sqrt(1 - h * h), w;

    tandem_set_key(p, "gravity.vector", "[0, 0, -9.81]");
    tandem_set_key(p, "body.bob.mass", "2.0");
    tandem_set_key(p, "body.bob.position", "[0.6, 0, -0.8]");
    tandem_set_key(p, "body.bob.velocity", "[0, 2.2, 0]");
    tandem_set_key(p, "constraint.string.type", "\"distance\"");
    tandem_set_key(p, "constraint.string.between", "[\"ground\", \"bob\"]");
    expect("a-bob-on-a-string", p, tandem_define(p, 0, 0, 0, 10), TANDEM_OK, "ok");
    tandem_get_drawing(p, q, qd);
    expect("a-rate-is-held", p, tandem_find_steady_motion(p, 0, q, qd, "any, world.rotation_z=4"), TANDEM_OK, "ok");
    check("where-it-turns-so-fast", fabs(q[2] + h) < 1e-12 && fabs(hypot(q[0], q[1]) - r) < 1e-12, "elsewhere");
    check("at-that-rate", fabs(q[0] * qd[1] - q[1] * qd[0] - 4 * r * r) < 1e-12 && fabs(qd[2]) < 1e-12, "at another");
    tandem_get_drawing(p, q, qd);
    expect("without-a-rate", p, tandem_find_steady_motion(p, 0, q, qd, NULL), TANDEM_OK, "ok");
    w = (q[0] * qd[1] - q[1] * qd[0]) / (q[0] * q[0] + q[1] * q[1]);
    check("its-rate-stays", fabs(w - 2.2 / 0.6) < 1e-9 && fabs(w * w * -q[2] - 9.81) < 1e-9, "they do not");
    expect("a-motion-that-there-is-not", p, tandem_find_steady_motion(p, 0, q, qd, "world.rotation_q"), TANDEM_NO_EQUILIBRIUM, "rotation_q");
    expect("a-rate-that-is-none", p, tandem_find_steady_motion(p, 0, q, qd, "world.rotation_z=fast"), TANDEM_INVALID_OPTION, "not a number");
    expect("a-rate-of-a-group", p, tandem_find_steady_motion(p, 0, q, qd, "world.rotation=1"), TANDEM_INVALID_OPTION, "no rate of");
    expect("no-state", p, tandem_find_steady_motion(p, 0, q, NULL, NULL), TANDEM_INVALID_OPTION, "NULL");
    tandem_free(p);
}

static void test_misuse(void)
{
    struct bowl b = new_bowl();
    tandem_problem *p = bowl_problem(&b);
    double x[N], wrong[N] = {1, 0, 0.5, 0.3}, value = 1;
    char longest[1000];

    check("null-has-a-message", strstr(tandem_message(NULL), "handle") != NULL, tandem_message(NULL));
    tandem_free(NULL);
    int status = tandem_set_position_function(NULL, "holonomic", bowl_phi) + tandem_set_motion_function(NULL, "gamma_q", NULL) +
                 tandem_set_direction_function(NULL, "mass_derivative", NULL) + tandem_set_evaluate(NULL, NULL, 1) +
                 tandem_set_row_name(NULL, 0, "row") + tandem_set_real(NULL, "step", 1) + tandem_set_integer(NULL, "max_steps", 1) +
                 tandem_set_text(NULL, "stepper", "rk4") + tandem_set_vector(NULL, "breakpoints", 0, NULL) +
                 tandem_check(NULL, 0, x, x) + tandem_start(NULL, 0, x, x) + tandem_integrate(NULL, 1) + tandem_step(NULL, 1) +
                 tandem_get_state(NULL, x, x, x, x) + tandem_get_state_at(NULL, 0, x, x, x) + tandem_get_multipliers(NULL, 0, x) +
                 tandem_get_energies(NULL, x, x) + tandem_get_statistic(NULL, "steps", x) + tandem_save_state(NULL, 0, NULL, NULL) +
                 tandem_restore_state(NULL, 0, NULL) + tandem_count_warnings(NULL, NULL) + tandem_get_warning(NULL, 0, 0, NULL) +
                 tandem_set_key(NULL, "body.a.mass", "1") + tandem_define(NULL, 1, 0, 0, 1) + tandem_get_sizes(NULL, NULL, NULL, NULL) +
                 tandem_get_drawing(NULL, x, x) + tandem_get_name(NULL, "row", 0, 0, NULL) +
                 tandem_find_steady_motion(NULL, 0, x, x, NULL);
    check("null-is-refused-everywhere", status == 28 * TANDEM_INVALID_OPTION && tandem_get_segment(NULL) == 0, "not by all");

    expect("no-step-before-the-start", p, tandem_step(p, 1), TANDEM_INVALID_OPTION, "tandem_start");
    expect("no-run-before-the-start", p, tandem_integrate(p, 1), TANDEM_INVALID_OPTION, "tandem_start");
    expect("no-state-before-the-start", p, tandem_get_state(p, NULL, x, x, x), TANDEM_INVALID_OPTION, "tandem_start");
    expect("no-statistic-before-the-start", p, tandem_get_statistic(p, "steps", &value), TANDEM_INVALID_OPTION, "tandem_start");
    check("and-its-value-is-zero", value == 0, "not zero");
    expect("null-start", p, tandem_start(p, 0, NULL, bowl_qd), TANDEM_INVALID_OPTION, "NULL");
    expect("nan-start", p, tandem_start(p, NAN, bowl_q, bowl_qd), TANDEM_INVALID_OPTION, "not finite");
    expect("unknown-real-option", p, tandem_set_real(p, "stepp", 1), TANDEM_INVALID_OPTION, "rtol");
    expect("unknown-integer-option", p, tandem_set_integer(p, "steps", 1), TANDEM_INVALID_OPTION, "max_steps");
    expect("unknown-text-option", p, tandem_set_text(p, "method", "rk4"), TANDEM_INVALID_OPTION, "stepper");
    expect("unknown-list", p, tandem_set_vector(p, "scale", 1, &value), TANDEM_INVALID_OPTION, "coordinate_scale");
    expect("null-list", p, tandem_set_vector(p, "breakpoints", 3, NULL), TANDEM_INVALID_OPTION, "NULL");
    expect("negative-list", p, tandem_set_vector(p, "breakpoints", -3, x), TANDEM_INVALID_OPTION, "negative");
    expect("null-name", p, tandem_set_real(p, NULL, 1), TANDEM_INVALID_OPTION, "not a real option");
    memset(longest, 'x', sizeof longest);
    longest[sizeof longest - 1] = 0;
    expect("endless-name", p, tandem_set_real(p, longest, 1), TANDEM_INVALID_OPTION, "not a real option");
    expect("endless-value", p, tandem_set_text(p, "stepper", longest), TANDEM_INVALID_OPTION, "unknown");
    expect("unknown-function", p, tandem_set_position_function(p, "phi", bowl_phi), TANDEM_INVALID_OPTION, "holonomic");
    expect("function-of-another-kind", p, tandem_set_position_function(p, "applied_force", bowl_phi), TANDEM_INVALID_OPTION,
           "(t, q)");
    tandem_set_evaluate(p, bowl_evaluate, TANDEM_MASS);
    expect("null-takes-a-function-of-all-back", p, tandem_set_evaluate(p, NULL, 0), TANDEM_OK, "ok");
    expect("provides-must-be-given-with-a-function", p, tandem_set_evaluate(p, bowl_evaluate, 0), TANDEM_INVALID_OPTION,
           "provides");
    expect("impossible-provides", p, tandem_set_evaluate(p, bowl_evaluate, 64), TANDEM_INVALID_OPTION, "64");
    expect("no-such-row", p, tandem_set_row_name(p, 2, "row"), TANDEM_INVALID_OPTION, "row");

    tandem_set_row_name(p, 0, "bowl");
    expect("a-wrong-start-names-the-row", p, tandem_start(p, 0, wrong, bowl_qd), TANDEM_INCONSISTENT_START, "\"bowl\"");
    expect("unknown-stepper", p, tandem_set_text(p, "stepper", "euler"), TANDEM_INVALID_OPTION, "dop853");
    tandem_set_text(p, "stepper", "trapezoid");
    tandem_set_text(p, "projection", "step_ends");
    expect("projection-of-implicit-steps", p, tandem_start(p, 0, bowl_q, bowl_qd), TANDEM_INVALID_OPTION, "explicit stepper");
    tandem_set_text(p, "stepper", "rk4");
    expect("projection-of-explicit-steps", p, tandem_start(p, 0, bowl_q, bowl_qd), TANDEM_OK, "ok");
    tandem_set_text(p, "projection", "stages");
    expect("negative-step", p, tandem_set_real(p, "step", -1), TANDEM_INVALID_OPTION, "step");
    tandem_set_vector(p, "coordinate_scale", 2, x);
    expect("scale-of-a-wrong-length", p, tandem_start(p, 0, bowl_q, bowl_qd), TANDEM_INVALID_MODEL, "coordinate_scale");
    expect("a-scale-is-taken-back", p, tandem_set_vector(p, "coordinate_scale", 0, NULL), TANDEM_OK, "ok");
    expect("and-is-one-again", p, tandem_start(p, 0, bowl_q, bowl_qd), TANDEM_OK, "ok");
    for (int i = 0; i < N; i++) x[i] = 1;
    tandem_set_vector(p, "coordinate_scale", N, x);
    expect("a-start-can-be-made-good", p, tandem_start(p, 0, bowl_q, bowl_qd), TANDEM_OK, "ok");
    expect("an-end-in-the-past", p, tandem_integrate(p, -1), TANDEM_INVALID_OPTION, "after the current time");
    expect("an-end-that-is-nan", p, tandem_integrate(p, NAN), TANDEM_INVALID_OPTION, "finite");
    expect("a-limit-in-the-past", p, tandem_step(p, 0), TANDEM_INVALID_OPTION, "after the current time");
    expect("a-limit-that-is-infinite", p, tandem_step(p, INFINITY), TANDEM_INVALID_OPTION, "finite");
    expect("unknown-statistic", p, tandem_get_statistic(p, "step", &value), TANDEM_INVALID_OPTION, "right_hand_sides");
    expect("null-multipliers", p, tandem_get_multipliers(p, 0, NULL), TANDEM_INVALID_OPTION, "NULL");
    expect("everything-may-be-null", p, tandem_get_state(p, NULL, NULL, NULL, NULL), TANDEM_OK, "ok");
    check("a-good-call-clears-the-message", strncmp(tandem_message(p), "ok", 2) == 0, tandem_message(p));
    tandem_set_integer(p, "max_steps", 3);
    tandem_start(p, 0, bowl_q, bowl_qd);
    expect("the-limit-of-steps", p, tandem_integrate(p, 1), TANDEM_STEP_LIMIT, "3 steps");
    tandem_set_integer(p, "max_evaluations", 6);
    tandem_start(p, 0, bowl_q, bowl_qd);
    expect("the-limit-of-evaluations", p, tandem_integrate(p, 1), TANDEM_WORK_LIMIT, "max_evaluations = 6");
    tandem_set_integer(p, "max_evaluations", 0);
    expect("no-negative-time", p, tandem_set_real(p, "max_seconds", -1), TANDEM_INVALID_OPTION, "max_seconds");
    expect("no-limit-of-no-events", p, tandem_set_integer(p, "max_events", 0), TANDEM_INVALID_OPTION, "max_events = 0");
    tandem_set_motion_function(p, "applied_force", NULL);
    expect("a-changed-model-must-be-started", p, tandem_step(p, 2), TANDEM_INVALID_OPTION, "tandem_start");
    tandem_free(p);
}

int main(void)
{
    test_run();
    test_steps();
    test_output_times();
    test_advance();
    test_derivatives();
    test_breakpoints();
    test_driven();
    test_names();
    test_statistics();
    test_tolerances();
    test_assembly();
    test_events();
    test_error();
    test_warnings();
    test_check();
    test_missing();
    test_sizes();
    test_faults();
    test_auto();
    test_saved();
    test_mass_blocks();
    test_message();
    test_changes();
    test_values();
    test_given_back();
    test_units();
    test_unset();
    test_advice();
    test_linearised();
    test_mechanism();
    test_steady_motion();
    test_misuse();
    return failures > 0;
}
