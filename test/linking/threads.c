/* SPDX-License-Identifier: MIT
 *
 * Eight threads, each with a problem of its own, give bitwise what the same problems give one after another. The problems
 * differ in parameters, steppers and the way their functions are given.
 */
#include "bowl.h"
#include <omp.h>
#include <stdio.h>

enum { PROBLEMS = 8, ROUNDS = 3 };

struct result {
    double state[2 * N], lambda[NC], steps, evaluations;
    int status, thread;
};

static struct result solve(int i)
{
    static const char *const steppers[] = {"rk4", "dopri5", "dop853", "sdirk54", "trapezoid", "dop853", "rk4", "sdirk54"};
    struct bowl b = new_bowl();
    struct result r = {.thread = omp_get_thread_num()};
    double q[N], qd[N], t;
    b.m = 1 + i;
    b.inertia = 0.2 + 0.1 * i;
    b.eager = i % 4 == 1;
    memcpy(q, bowl_q, sizeof q);
    memcpy(qd, bowl_qd, sizeof qd);
    qd[2] += i;
    tandem_problem *p = i % 2 ? bowl_problem_at_once(&b) : bowl_problem(&b);
    tandem_set_text(p, "stepper", steppers[i]);
    tandem_set_real(p, "step", i == 2 || i == 5 ? 0 : 1e-3);
    if (i == 2 || i == 5) tandem_set_real(p, "rtol", 1e-9);
    if (i == 7) bowl_derivatives(p);
    r.status = tandem_start(p, 0, q, qd);
    for (int j = 1; r.status == 0 && j <= 20; j++) r.status = tandem_integrate(p, 0.05 * j);
    if (r.status == 0) r.status = tandem_get_state(p, &t, r.state, r.state + N, NULL);
    if (r.status == 0) r.status = tandem_get_multipliers(p, t, r.lambda);
    if (r.status == 0) r.status = tandem_get_statistic(p, "steps", &r.steps);
    if (r.status == 0) r.status = tandem_get_statistic(p, "right_hand_sides", &r.evaluations);
    if (r.status) printf("    %d: %s\n", i, tandem_message(p));
    tandem_free(p);
    return r;
}

int main(void)
{
    struct result alone[PROBLEMS], together[ROUNDS * PROBLEMS];
    int wrong = 0, seen[PROBLEMS] = {0}, threads = 0;
    for (int i = 0; i < PROBLEMS; i++) alone[i] = solve(i);
#pragma omp parallel for schedule(static, 1) num_threads(PROBLEMS)
    for (int i = 0; i < ROUNDS * PROBLEMS; i++) together[i] = solve((i + i / PROBLEMS) % PROBLEMS);
    for (int i = 0; i < ROUNDS * PROBLEMS; i++) {
        struct result a = alone[(i + i / PROBLEMS) % PROBLEMS], b = together[i];
        int same = a.status == 0 && memcmp(a.state, b.state, sizeof a.state) == 0 &&
                   memcmp(a.lambda, b.lambda, sizeof a.lambda) == 0 && a.steps == b.steps && a.evaluations == b.evaluations;
        wrong += !same || a.steps == 0;
        threads += !seen[b.thread];
        seen[b.thread] = 1;
    }
    printf("%s eight-threads-ran\n", threads == PROBLEMS ? "ok" : "not ok");
    printf("%s eight-threads-give-bitwise-the-results-of-one\n", wrong ? "not ok" : "ok");
    if (wrong) printf("    %d of %d runs differ\n", wrong, ROUNDS * PROBLEMS);
    return wrong || threads != PROBLEMS;
}
