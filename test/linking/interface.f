C     SPDX-License-Identifier: MIT
C
C     Tests of the Fortran 77 interface on a knife edge: "ok NAME" or
C     "not ok NAME" for each. The procedures of the model are given at
C     once (EVAL) or by name, and everything wrong that a caller can do
C     must end in a status and a text.
C
      PROGRAM TESTS
      USE, INTRINSIC :: IEEE_EXCEPTIONS
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      INCLUDE 'tandem.inc'
      DIMENSION Q(3), QD(3), QDD(3), Q2(3), QD2(3), RPAR(3), IPAR(3)
      DIMENSION IH(TDHLEN), JH(TDHLEN), KH(TDHLEN), ALAM(1)
      PARAMETER (MSAVE = 20000)
      DIMENSION ISAVE(MSAVE)
      CHARACTER*300 WARN
      CHARACTER*(TDTLEN) WHOLE
      DIMENSION LH(TDHLEN), REAL2(6), AIMA2(6), AMAT2(36)
      LOGICAL FLAGS(5)
      EXTERNAL EVAL, EDGE, GAMMA, AMASS, FORCE, POTEN, LEAVE
      EXTERNAL AMDER, TURNED, ONE, SPRING
      COMMON /COUNT/ NFAIL
      COMMON /SELF/ ME(TDHLEN), KERR
      NFAIL = 0
C     Mass, moment of inertia, downhill gravity; IPAR: calls, fault.
      RPAR(1) = 2.0D0
      RPAR(2) = 0.2D0
      RPAR(3) = 9.81D0*SIN(0.3D0)
      IPAR(1) = 0
      IPAR(2) = 0
C
      CALL TDVERS (IVER)
      CALL TOLD ('versions-agree', IVER .EQ. TDIVER)
C
C     One problem by a single procedure, one by several.
      CALL TDNEW (IH, 3, 0, 1, IERR)
      CALL OK ('a-problem-is-made', IH, IERR)
      CALL TDEVAL (IH, EVAL, TDJAC+TDGAM+TDMASS+TDFORC, IERR)
      CALL OK ('one-procedure-gives-all-terms', IH, IERR)
      CALL TDNEW (JH, 3, 0, 1, IERR)
      CALL TDPOS (JH, 'Nonholonomic_Jacobian', EDGE, IERR)
      CALL OK ('names-come-in-either-case', JH, IERR)
      CALL TDMOT (JH, 'constraint_acceleration', GAMMA, IERR)
      CALL TDPOS (JH, 'mass_matrix    ', AMASS, IERR)
      CALL OK ('names-may-have-blanks-behind', JH, IERR)
      CALL TDMOT (JH, 'applied_force', FORCE, IERR)
      CALL TDPOS (JH, 'potential_energy', POTEN, IERR)
      CALL TDSETR (IH, 'step', 2.0D-3, IERR)
      CALL TDSETR (JH, 'step', 2.0D-3, IERR)
C
C     The check of the model, before anything runs. It leaves no flags
C     of exceptions, which a program would print at its end.
      T = 0.0D0
      CALL START (Q, QD)
      CALL IEEE_SET_FLAG (IEEE_ALL, .FALSE.)
      IPAR(2) = 6
      CALL TDCHCK (IH, T, Q, QD, RPAR, IPAR, IERR)
      CALL TDCHCK (JH, T, Q, QD, RPAR, IPAR, IERR)
      IPAR(2) = 0
      CALL IEEE_GET_FLAG (IEEE_ALL, FLAGS)
      CALL TOLD ('the-check-leaves-no-flags', .NOT. (FLAGS(1) .OR.
     &           FLAGS(2) .OR. FLAGS(3) .OR. FLAGS(4)))
      CALL TDCHCK (IH, T, Q, QD, RPAR, IPAR, IERR)
      CALL OK ('one-procedure-passes-the-check', IH, IERR)
      CALL TDCHCK (JH, T, Q, QD, RPAR, IPAR, IERR)
      CALL OK ('several-procedures-pass-the-check', JH, IERR)
      IPAR(2) = 3
      CALL BAD ('the-check-finds-the-sign-of-gamma', JH, TDEMOD,
     &          'constraint_acceleration is wrong by 2.')
      CALL TDCHCK (JH, T, Q, QD, RPAR, IPAR, IERR)
      CALL WAS (JH, IERR)
      IPAR(2) = 4
      CALL BAD ('and-where-the-mass-is-not-symmetric', JH, TDEMOD,
     &          'entry (2,1) is')
      CALL TDCHCK (JH, T, Q, QD, RPAR, IPAR, IERR)
      CALL WAS (JH, IERR)
      IPAR(2) = 0
C
      T = 0.0D0
      CALL START (Q, QD)
      CALL TDSTRT (IH, T, Q, QD, RPAR, IPAR, IERR)
      CALL OK ('a-run-starts', IH, IERR)
      CALL TDINTG (IH, T, Q, QD, 2.0D0, RPAR, IPAR, IERR)
      CALL OK ('one-call-integrates', IH, IERR)
      CALL TOLD ('to-the-end', ABS(T - 2.0D0) .LE. 0.0D0)
      W = 1.5D0
      A = RPAR(3)/(4.0D0*W**2)
      B = 2.0D0*W*T
      ERR = ABS(Q(1) - A*(1.0D0 - COS(B)))
      ERR = MAX(ERR, ABS(Q(2) - A*(B - SIN(B))), ABS(Q(3) - W*T))
C     RK4 with h = 2 ms leaves about 1e-12.
      CALL TOLD ('as-in-closed-form', ERR .LT. 1.0D-10)
      CALL TOLD ('ipar-goes-through', IPAR(1) .GT. 4000)
      CALL TDSTAT (IH, 'steps', STEPS, IERR)
      CALL TOLD ('steps-are-counted', NINT(STEPS) .EQ. 1000)
C     The side force: m (g sin(phi) + u w), u = g sin(phi)/w.
      CALL TDLAMB (IH, T, ALAM, RPAR, IPAR, IERR)
      EXACT = 2.0D0*RPAR(1)*RPAR(3)*SIN(W*T)
      CALL TOLD ('multiplier-as-in-closed-form',
     &           ABS(ALAM(1) - EXACT) .LT. 1.0D-9)
C
      T2 = 0.0D0
      CALL START (Q2, QD2)
      CALL TDSTRT (JH, T2, Q2, QD2, RPAR, IPAR, IERR)
      CALL OK ('several-procedures-start', JH, IERR)
      CALL TDINTG (JH, T2, Q2, QD2, T2, RPAR, IPAR, IERR)
      CALL OK ('output-times-may-begin-with-the-start', JH, IERR)
      CALL TOLD ('and-the-state-is-the-start', ABS(T2) .LE. 0.0D0 .AND.
     &           ABS(QD2(3) - 1.5D0) .LE. 0.0D0)
      CALL TDENER (JH, EKIN, EPOT, RPAR, IPAR, IERR)
      E0 = EKIN + EPOT
      IPAR(1) = 0
   10 IF (T2 .LT. 2.0D0) THEN
        CALL TDSTEP (JH, T2, Q2, QD2, 2.0D0, RPAR, IPAR, IERR)
        IF (IERR .EQ. 0) GO TO 10
      END IF
      CALL OK ('the-caller-keeps-its-loop', JH, IERR)
      CALL TOLD ('bitwise-as-in-one-call', ABS(Q(1) - Q2(1)) .LE. 0.0D0
     &           .AND. ABS(QD(2) - QD2(2)) .LE. 0.0D0)
      CALL TDENER (JH, EKIN, EPOT, RPAR, IPAR, IERR)
      CALL TOLD ('energy-is-constant', ABS(EKIN + EPOT - E0) .LT.
     &           1.0D-10 .AND. EKIN .GT. 0.25D0)
      CALL TDDENS (JH, T2 - 1.0D-3, Q, QD, QDD, RPAR, IPAR, IERR)
      CALL OK ('dense-output', JH, IERR)
      CALL TOLD ('dense-output-does-not-slip', ABS(SIN(Q(3))*QD(1) -
     &           COS(Q(3))*QD(2)) .LT. 1.0D-12)
      CALL BAD ('but-not-before-the-step', JH, TDEOPT, 'last step')
      CALL TDDENS (JH, 1.0D0, Q, QD, QDD, RPAR, IPAR, IERR)
      CALL WAS (JH, IERR)
C
C     Warnings: none here; one where the steps are far too large.
      CALL TDNWRN (JH, NWARN, IERR)
      CALL OK ('warnings-are-counted', JH, IERR)
      CALL TOLD ('a-good-run-has-none', NWARN .EQ. 0)
      CALL BAD ('there-is-no-first-warning', JH, TDEOPT, 'has 0')
      CALL TDWARN (JH, 1, WARN, IERR)
      CALL WAS (JH, IERR)
      CALL TDSTAT (JH, 'LOCAL_ERROR_SUM', ESUM, IERR)
      CALL OK ('the-error-of-steps-is-told', JH, IERR)
      CALL TOLD ('and-is-small', ESUM .GT. 0.0D0 .AND.
     &           ESUM .LT. 1.0D-8)
      CALL TDNEW (KH, 3, 0, 1, IERR)
      CALL TDEVAL (KH, EVAL, TDJAC+TDGAM+TDMASS+TDFORC, IERR)
      CALL TDSETR (KH, 'step', 0.5D0, IERR)
      CALL START (Q, QD)
      CALL TDSTRT (KH, 0.0D0, Q, QD, RPAR, IPAR, IERR)
      CALL TDINTG (KH, T, Q, QD, 10.0D0, RPAR, IPAR, IERR)
      CALL TDNWRN (KH, NWARN, IERR)
      CALL TOLD ('a-wrong-run-has-a-warning', NWARN .GT. 0)
      CALL TDWARN (KH, 1, WARN, IERR)
      CALL OK ('which-is-given', KH, IERR)
      CALL TOLD ('and-says-what-to-do',
     &           INDEX(WARN, 'take smaller steps') .GT. 0)
      CALL TDFREE (KH, IERR)
C
C     A run that is saved goes on in another problem, from another start.
      CALL TDSAVE (JH, 0, ISAVE, NEED, IERR)
      CALL OK ('a-state-is-counted', JH, IERR)
      CALL TOLD ('and-has-some-integers', NEED .GT. 0 .AND.
     &           NEED .LE. MSAVE)
      CALL BAD ('no-room-for-a-state', JH, TDEOPT, 'capacity is 5')
      CALL TDSAVE (JH, 5, ISAVE, NEED, IERR)
      CALL WAS (JH, IERR)
      NEED = MSAVE
      CALL TDSAVE (JH, NEED, ISAVE, NEED, IERR)
      CALL OK ('a-state-is-saved', JH, IERR)
      CALL TDINTG (JH, T2, Q2, QD2, 3.0D0, RPAR, IPAR, IERR)
      CALL TDNEW (KH, 3, 0, 1, IERR)
      CALL TDEVAL (KH, EVAL, TDJAC+TDGAM+TDMASS+TDFORC, IERR)
      CALL TDSETR (KH, 'step', 2.0D-3, IERR)
      CALL BAD ('no-state-without-a-start', KH, TDEOPT, 'TDSTRT')
      CALL TDREST (KH, NEED, ISAVE, IERR)
      CALL WAS (KH, IERR)
      CALL START (Q, QD)
      CALL TDSTRT (KH, 1.0D0, Q, QD, RPAR, IPAR, IERR)
      CALL TDREST (KH, NEED, ISAVE, IERR)
      CALL OK ('a-state-is-restored', KH, IERR)
      CALL TDINTG (KH, T, Q, QD, 3.0D0, RPAR, IPAR, IERR)
      CALL TOLD ('bitwise-as-if-nothing-had-been', IERR .EQ. 0 .AND.
     &           ABS(T - T2) .LE. 0.0D0 .AND. ABS(Q(1) - Q2(1)) .LE.
     &           0.0D0 .AND. ABS(QD(2) - QD2(2)) .LE. 0.0D0)
      CALL BAD ('a-negative-state', KH, TDEOPT, 'negative')
      CALL TDREST (KH, -1, ISAVE, IERR)
      CALL WAS (KH, IERR)
      CALL BAD ('an-odd-state', KH, TDEOPT, 'odd')
      CALL TDREST (KH, NEED-1, ISAVE, IERR)
      CALL WAS (KH, IERR)
      CALL BAD ('half-a-state', KH, TDECHK, 'truncated')
      CALL TDREST (KH, 2*(NEED/4), ISAVE, IERR)
      CALL WAS (KH, IERR)
      CALL TDFREE (KH, IERR)
C
C     Events: the angle of the knife is 1.5 T.
      CALL TDNEW (KH, 3, 0, 1, IERR)
      CALL TDEVAL (KH, EVAL, TDJAC+TDGAM+TDMASS+TDFORC, IERR)
      CALL TDSETR (KH, 'step', 2.0D-3, IERR)
      CALL TDEVNT (KH, 'half', 'q', 3, 0.75D0, 1, 0, IERR)
      CALL OK ('a-coordinate-is-watched', KH, IERR)
      CALL TDEVFN (KH, 'turned', TURNED, 0, 1, IERR)
      CALL OK ('a-function-is-watched', KH, IERR)
      CALL BAD ('one-that-is-none-is-not', KH, TDEOPT, 'no function')
      CALL TDEVFN (KH, 'none', TDNONE, 0, 1, IERR)
      CALL WAS (KH, IERR)
      CALL BAD ('nor-a-coordinate-that-is-none', KH, TDEOPT,
     &          'it has 3 entries')
      CALL TDEVNT (KH, 'x', 'Q', 0, 0.75D0, 1, 0, IERR)
      CALL WAS (KH, IERR)
      CALL START (Q, QD)
      CALL TDSTRT (KH, 0.0D0, Q, QD, RPAR, IPAR, IERR)
      CALL TDINTG (KH, T, Q, QD, 2.0D0, RPAR, IPAR, IERR)
      CALL OK ('a-run-may-be-stopped', KH, IERR)
C     A zero is found to 1E-13 of a step, and rounding is left.
      CALL TOLD ('where-the-function-is-zero',
     &           ABS(T - 1.0D0) .LT. 1.0D-12)
      CALL TDSTOP (KH, NUMBER, IERR)
      CALL TOLD ('by-the-second-event', IERR .EQ. 0 .AND.
     &           NUMBER .EQ. 2)
      CALL TDNEVT (KH, NEVENT, IERR)
      CALL TOLD ('two-were-recorded', IERR .EQ. 0 .AND.
     &           NEVENT .EQ. 2)
      CALL TDGEVT (KH, 1, NUMBER, IDIR, T3, Q2, QD2, IERR)
      CALL OK ('the-first-is-told', KH, IERR)
      CALL TOLD ('which-is-the-coordinate', NUMBER .EQ. 1 .AND.
     &           IDIR .EQ. 1 .AND. ABS(T3 - 0.5D0) .LT. 1.0D-12 .AND.
     &           ABS(Q2(3) - 0.75D0) .LT. 1.0D-12)
      CALL BAD ('there-is-no-third', KH, TDEOPT, 'has recorded 2')
      CALL TDGEVT (KH, 3, NUMBER, IDIR, T3, Q2, QD2, IERR)
      CALL WAS (KH, IERR)
      CALL TDEVCL (KH, IERR)
      CALL OK ('events-are-taken-back', KH, IERR)
C
C     The error by a second run.
      CALL TDSETR (KH, 'step', 5.0D-2, IERR)
      CALL START (Q, QD)
      CALL TDSTRT (KH, 0.0D0, Q, QD, RPAR, IPAR, IERR)
      CALL BAD ('no-error-of-a-run-not-watched', KH, TDEOPT,
     &          'call TDWERR there')
      CALL TDEERR (KH, RPAR, IPAR, IERR)
      CALL WAS (KH, IERR)
      CALL TDWERR (KH, 2.0D0, IERR)
      CALL OK ('a-run-is-watched', KH, IERR)
      CALL TDINTG (KH, T, Q, QD, 2.0D0, RPAR, IPAR, IERR)
      CALL TOLD ('no-event-stops-it-now', ABS(T - 2.0D0) .LE. 0.0D0)
      CALL TDEERR (KH, RPAR, IPAR, IERR)
      CALL OK ('its-error-is-estimated', KH, IERR)
      CALL TDSTAT (KH, 'GLOBAL_ERROR_Q', TOLDQ, IERR)
      CALL OK ('and-told', KH, IERR)
      W = 1.5D0
      A = RPAR(3)/(4.0D0*W**2)
      B = 2.0D0*W*T
      ERR = MAX(ABS(Q(1) - A*(1.0D0 - COS(B))),
     &          ABS(Q(2) - A*(B - SIN(B))))
C     An estimate is right to a factor of two.
      CALL TOLD ('and-right', ERR .GT. 1.0D-9 .AND. TOLDQ .GT.
     &           0.5D0*ERR .AND. TOLDQ .LT. 2.0D0*ERR)
      CALL TDFREE (KH, IERR)
C
C     AUTO, on a spring that is far stiffer than the motion SIN(T).
      CALL TDNEW (KH, 1, 0, 0, IERR)
      CALL TDPOS (KH, 'mass_matrix', ONE, IERR)
      CALL TDMOT (KH, 'applied_force', SPRING, IERR)
      CALL TDSETS (KH, 'stepper', 'AUTO', IERR)
      CALL OK ('auto-is-taken', KH, IERR)
      Q2(1) = 0.0D0
      QD2(1) = 1.0D0
      CALL TDSETR (KH, 'rtol', 1.0D-6, IERR)
      CALL TDSETR (KH, 'step', 1.0D-3, IERR)
      CALL BAD ('step-or-rtol', KH, TDEOPT, 'remove step or rtol')
      CALL TDSTRT (KH, 0.0D0, Q2, QD2, RPAR, IPAR, IERR)
      CALL WAS (KH, IERR)
      CALL TDSETR (KH, 'step', 0.0D0, IERR)
      CALL TDSTRT (KH, 0.0D0, Q2, QD2, RPAR, IPAR, IERR)
      CALL TDINTG (KH, T3, Q2, QD2, 2.0D0, RPAR, IPAR, IERR)
      CALL OK ('auto-runs', KH, IERR)
      CALL TOLD ('auto-is-right', ABS(Q2(1) - SIN(2.0D0)) .LT. 1.0D-5
     &           .AND. ABS(QD2(1) - COS(2.0D0)) .LT. 1.0D-5)
      CALL TDSTAT (KH, 'switches', SWITCH, IERR)
      CALL TDSTAT (KH, 'steps', STEPS, IERR)
C     DOP853 alone would need some 1E4/6 steps a second.
      CALL TOLD ('auto-goes-over-to-radau5', SWITCH .GT. 0.5D0 .AND.
     &           STEPS .LT. 1.0D3)
      CALL TDFREE (KH, IERR)
C
C     A derivative, by its name and as none.
      CALL TDDIR (JH, 'mass_derivative', AMDER, IERR)
      CALL OK ('a-derivative-is-taken', JH, IERR)
      CALL TDSETS (JH, 'stepper', 'trapezoid', IERR)
      CALL TDSETI (JH, 'max_steps', 1000, IERR)
      CALL OK ('an-integer-is-taken', JH, IERR)
      CALL TDSETV (JH, 'breakpoints', 0, Q2, IERR)
      CALL OK ('a-list-is-taken', JH, IERR)
      CALL START (Q2, QD2)
      CALL TDSTRT (JH, 0.0D0, Q2, QD2, RPAR, IPAR, IERR)
      IPAR(3) = 0
      CALL TDINTG (JH, T, Q, QD, 1.0D-2, RPAR, IPAR, IERR)
      CALL OK ('an-implicit-run-ends', JH, IERR)
      CALL TOLD ('its-derivative-is-called', IPAR(3) .GT. 0)
      CALL BAD ('a-derivative-of-another-kind', JH, TDEOPT,
     &          'mass_derivative')
      CALL TDDIR (JH, 'mass_matrix', AMDER, IERR)
      CALL WAS (JH, IERR)
      CALL TDDIR (JH, 'mass_derivative', TDNONE, IERR)
      CALL OK ('and-taken-back', JH, IERR)
      CALL TDSETS (JH, 'stepper', 'rk4', IERR)
C
C     What stands for none.
      CALL TDPOS (JH, 'mass_matrix', TDNONE, IERR)
      CALL START (Q2, QD2)
      CALL BAD ('tdnone-takes-a-procedure-back', JH, TDEMOD, 'mass')
      CALL TDSTRT (JH, 0.0D0, Q2, QD2, RPAR, IPAR, IERR)
      CALL WAS (JH, IERR)
      CALL TDPOS (JH, 'mass_matrix', AMASS, IERR)
      CALL TDMOT (JH, 'constraint_acceleration', TDNONE, IERR)
      CALL TDSTRT (JH, 0.0D0, Q2, QD2, RPAR, IPAR, IERR)
      CALL OK ('differences-stand-in-for-gamma', JH, IERR)
      CALL TDEVAL (IH, TDNONE, 0, IERR)
      CALL OK ('all-at-once-is-taken-back', IH, IERR)
      CALL TDEVAL (IH, TDNONE, TDMASS, IERR)
      CALL OK ('with-any-sum', IH, IERR)
      CALL BAD ('tdnone-for-all-at-once', IH, TDEMOD, 'missing')
      CALL TDSTRT (IH, 0.0D0, Q2, QD2, RPAR, IPAR, IERR)
      CALL WAS (IH, IERR)
C
C     Procedures that fail.
      CALL TDEVAL (IH, EVAL, TDJAC+TDGAM+TDMASS+TDFORC, IERR)
      CALL TDSTRT (IH, 0.0D0, Q2, QD2, RPAR, IPAR, IERR)
      IPAR(2) = 1
      CALL BAD ('cannot-be-evaluated', IH, TDEEVL, 'evaluate')
      CALL TDINTG (IH, T, Q, QD, 1.0D0, RPAR, IPAR, IERR)
      CALL WAS (IH, IERR)
      CALL TOLD ('and-the-start-is-given-back', ABS(T) .LE.
     &           0.0D0)
      IPAR(2) = -1
      CALL BAD ('asks-to-stop', IH, TDECBK, 'evaluate')
      CALL TDINTG (IH, T, Q, QD, 1.0D0, RPAR, IPAR, IERR)
      CALL WAS (IH, IERR)
      IPAR(2) = 2
      CALL BAD ('gives-nan', IH, TDENAN, 'NaN')
      CALL TDINTG (IH, T, Q, QD, 1.0D0, RPAR, IPAR, IERR)
      CALL WAS (IH, IERR)
      IPAR(2) = 0
      CALL TDINTG (IH, T, Q, QD, 1.0D0, RPAR, IPAR, IERR)
      CALL OK ('and-can-be-made-good', IH, IERR)
C
C     A procedure that calls the problem that calls it, with another
C     RPAR: that is refused, and leaves nothing behind.
      DO 15 I = 1, TDHLEN
        ME(I) = IH(I)
   15 CONTINUE
      CALL START (Q2, QD2)
      CALL TDSTRT (IH, 0.0D0, Q2, QD2, RPAR, IPAR, IERR)
      CALL TDINTG (IH, T, Q, QD, 1.0D0, RPAR, IPAR, IERR)
      CALL TDSTRT (IH, 0.0D0, Q2, QD2, RPAR, IPAR, IERR)
      IPAR(2) = 5
      KERR = 0
      CALL TDINTG (IH, T, Q2, QD2, 1.0D0, RPAR, IPAR, IERR)
      CALL OK ('a-procedure-may-try-to-call-its-problem', IH, IERR)
      CALL TOLD ('which-is-refused', KERR .EQ. TDEOPT)
      CALL TOLD ('and-changes-nothing', ABS(Q(1) - Q2(1)) .LE. 0.0D0
     &           .AND. ABS(QD(2) - QD2(2)) .LE. 0.0D0)
      IPAR(2) = 0
C
C     What cannot be.
      CALL BAD ('unknown-option', IH, TDEOPT, 'rtol')
      CALL TDSETR (IH, 'tolerance', 1.0D-6, IERR)
      CALL WAS (IH, IERR)
      CALL BAD ('unknown-word', IH, TDEOPT, 'dopri5')
      CALL TDSETS (IH, 'STEPPER', 'RKF45', IERR)
      CALL WAS (IH, IERR)
      CALL BAD ('a-step-is-positive', IH, TDEOPT, 'step')
      CALL TDSETR (IH, 'step', -5.0D0, IERR)
      CALL WAS (IH, IERR)
      CALL BAD ('negative-list', IH, TDEOPT, 'negative')
      CALL TDSETV (IH, 'breakpoints', -1, Q, IERR)
      CALL WAS (IH, IERR)
      CALL TDROW (IH, 1, 'blade', IERR)
      CALL BAD ('wrong-start-names-the-row', IH, TDESTA, 'blade')
      QD2(2) = 1.0D0
      CALL TDSTRT (IH, 0.0D0, Q2, QD2, RPAR, IPAR, IERR)
      CALL WAS (IH, IERR)
      CALL TDTEXT (IH, WARN)
      CALL TOLD ('a-start-is-assembled-by-its-call',
     &           INDEX(WARN, 'move them by TDASSM') .GT. 0)
      CALL TDASSM (IH, 0.0D0, Q2, QD2, RPAR, IPAR, IERR)
      CALL OK ('a-start-is-assembled', IH, IERR)
C     The tolerance is 1E-12 of the size of the terms, about 1.
      CALL TOLD ('its-velocity-satisfies-the-constraint',
     &           ABS(SIN(Q2(3))*QD2(1) - COS(Q2(3))*QD2(2)) .LT.
     &           1.0D-11)
      CALL BAD ('no-run-without-a-start', IH, TDEOPT,
     &          'call TDSTRT first')
      CALL TDINTG (IH, T, Q, QD, 1.0D0, RPAR, IPAR, IERR)
      CALL WAS (IH, IERR)
      CALL TDNEW (KH, 3, 4, 0, IERR)
      CALL BAD ('impossible-sizes', KH, TDEMOD, 'at most')
      CALL WAS (KH, IERR)
      CALL TDSEGM (KH, ISEG)
      CALL TOLD ('the-segment-is-the-first', ISEG .EQ. 1)
C
C     A message as long as they come, a text as long, and a shorter one.
      CALL TDSTAT (IH, 'x', STEPS, IERR)
      CALL TDSTRT (IH, 0.0D0, QD, QD, RPAR, IPAR, IERR)
      CALL START (Q2, QD2)
      CALL TDSTRT (IH, 0.0D0, Q2, QD2, RPAR, IPAR, IERR)
      CALL TDSTAT (IH, 'x', STEPS, IERR)
      CALL TDTEXT (IH, WHOLE)
      CALL TOLD ('a-long-message-is-read-whole',
     &           INDEX(WHOLE, 'event_evaluations') .GT. 700 .AND.
     &           INDEX(WHOLE, '...') .EQ. 0)
      CALL TDTEXT (IH, WARN)
      CALL TOLD ('and-a-cut-one-says-so', WARN(298:300) .EQ. '...')
      CALL TOLD ('and-is-the-same-before', WARN(1:297) .EQ.
     &           WHOLE(1:297))
C
C     A procedure that sets nothing, and copies of a handle.
      CALL TDNEW (LH, 3, 0, 1, IERR)
      DO 17 I = 1, TDHLEN
        ME(I) = LH(I)
   17 CONTINUE
      CALL TDEVAL (LH, EVAL, TDJAC+TDGAM+TDMASS, IERR)
      CALL TDMOT (LH, 'applied_force', LEAVE, IERR)
      CALL BAD ('a-procedure-that-sets-nothing', LH, TDECBK, 'force')
      CALL TDSTRT (LH, 0.0D0, Q2, QD2, RPAR, IPAR, IERR)
      CALL WAS (LH, IERR)
      CALL TDFREE (LH, IERR)
      CALL BAD ('a-copy-of-a-handle-given-back', ME, TDEOPT, 'TDNEW')
      CALL TDINTG (ME, T, Q, QD, 1.0D0, RPAR, IPAR, IERR)
      CALL WAS (ME, IERR)
C
C     Linearised systems: of the second problem, N - NH coordinates
C     and N - NH - ND velocities.
      IPAR(2) = 0
      CALL START (Q, QD)
      CALL TDLIN (JH, 0.0D0, Q, QD, NEIG, REAL2, AIMA2, AMAT2, RPAR,
     &            IPAR, IERR)
      CALL OK ('a-problem-is-linearised', JH, IERR)
      CALL TOLD ('it-has-five-eigenvalues', NEIG .EQ. 5)
C
C     Handles.
      CALL TDFREE (IH, IERR)
      CALL TOLD ('a-problem-is-given-back', IERR .EQ. 0)
      CALL BAD ('a-handle-given-back', IH, TDEOPT, 'TDNEW')
      CALL TDFREE (IH, IERR)
      CALL WAS (IH, IERR)
      CALL BAD ('and-used', IH, TDEOPT, 'TDNEW')
      CALL TDINTG (IH, T, Q, QD, 1.0D0, RPAR, IPAR, IERR)
      CALL WAS (IH, IERR)
      CALL BAD ('and-checked', IH, TDEOPT, 'TDNEW')
      CALL TDCHCK (IH, T, Q, QD, RPAR, IPAR, IERR)
      CALL WAS (IH, IERR)
      DO 20 I = 1, TDHLEN
        IH(I) = 12345
   20 CONTINUE
      CALL BAD ('garbage-is-no-handle', IH, TDEOPT, 'TDNEW')
      CALL TDSETI (IH, 'max_steps', 10, IERR)
      CALL WAS (IH, IERR)
      CALL TDFREE (JH, IERR)
      CALL TDFREE (KH, IERR)
      IF (NFAIL .GT. 0) STOP 1
      END
C
      SUBROUTINE START (Q, QD)
      DOUBLE PRECISION Q(3), QD(3)
      INTEGER I
      DO 10 I = 1, 3
        Q(I) = 0.0D0
        QD(I) = 0.0D0
   10 CONTINUE
      QD(3) = 1.5D0
      END
C
      SUBROUTINE TOLD (NAME, PASSED)
      CHARACTER*(*) NAME
      LOGICAL PASSED
      INTEGER NFAIL
      COMMON /COUNT/ NFAIL
      IF (PASSED) THEN
        WRITE (*, '(2A)') 'ok ', NAME
      ELSE
        WRITE (*, '(2A)') 'not ok ', NAME
        NFAIL = NFAIL + 1
      END IF
      END
C
C     A call that must go well.
      SUBROUTINE OK (NAME, IH, IERR)
      CHARACTER*(*) NAME
      CHARACTER*200 TEXT
      INTEGER IH(4), IERR
      CALL TOLD (NAME, IERR .EQ. 0)
      CALL TDTEXT (IH, TEXT)
      IF (IERR .NE. 0) WRITE (*, '(4X, A)') TEXT
      END
C
C     BAD says what the next call must end with, WAS checks it.
      SUBROUTINE BAD (NAME, IH, IWANT, WORD)
      CHARACTER*(*) NAME, WORD
      CHARACTER*40 KNAME, KWORD
      CHARACTER*400 TEXT
      INTEGER IH(4), JH(4), IWANT, KWANT, IERR
      SAVE KNAME, KWORD, KWANT
      KNAME = NAME
      KWORD = WORD
      KWANT = IWANT
      RETURN
      ENTRY WAS (JH, IERR)
      CALL TDTEXT (JH, TEXT)
      CALL TOLD (KNAME, IERR .EQ. KWANT .AND.
     &           INDEX(TEXT, KWORD(1:INDEX(KWORD//'  ', '  ')-1))
     &           .GT. 0)
      IF (IERR .NE. KWANT) WRITE (*, '(4X, I4, 1X, A)') IERR, TEXT
      END
C
C     All terms of the model: those in NEED are set.
      SUBROUTINE EVAL (NEED, N, NH, ND, T, Q, QD, PHI, C, ANU, GAM, AM,
     &                 F, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      INCLUDE 'tandem.inc'
      DIMENSION Q(N), QD(N), PHI(*), C(NH+ND,N), ANU(*), GAM(NH+ND)
      DIMENSION AM(N,N), F(N), RPAR(*), IPAR(*)
      IF (IAND(NEED, TDJAC) .NE. 0)
     &  CALL EDGE (N, ND, T, Q, C, RPAR, IPAR, ISTAT)
      IF (IAND(NEED, TDGAM) .NE. 0)
     &  CALL GAMMA (N, ND, T, Q, QD, GAM, RPAR, IPAR, ISTAT)
      IF (IAND(NEED, TDMASS) .NE. 0)
     &  CALL AMASS (N, N, T, Q, AM, RPAR, IPAR, ISTAT)
      IF (IAND(NEED, TDFORC) .NE. 0) THEN
        CALL FORCE (N, N, T, Q, QD, F, RPAR, IPAR, ISTAT)
        IF (IPAR(2) .EQ. 2) F(1) = SQRT(-ABS(Q(3)) - 1.0D0)
      END IF
      IF (ABS(IPAR(2)) .EQ. 1) ISTAT = IPAR(2)
      END
C
      SUBROUTINE EDGE (N, M, T, Q, E, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      DIMENSION Q(N), E(M,N), RPAR(*), IPAR(*)
      E(1,1) = SIN(Q(3))
      E(1,2) = -COS(Q(3))
      E(1,3) = 0.0D0
      END
C
      SUBROUTINE GAMMA (N, M, T, Q, QD, G, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      DIMENSION Q(N), QD(N), G(M), RPAR(*), IPAR(*)
      G(1) = QD(3)*(COS(Q(3))*QD(1) + SIN(Q(3))*QD(2))
      IF (IPAR(2) .EQ. 3) G(1) = -G(1)
      END
C
      SUBROUTINE AMASS (N, M, T, Q, A, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      DIMENSION Q(N), A(M,N), RPAR(*), IPAR(*)
      DO 20 J = 1, N
        DO 10 I = 1, N
          A(I,J) = 0.0D0
   10   CONTINUE
   20 CONTINUE
      A(1,1) = RPAR(1)
      A(2,2) = RPAR(1)
      A(3,3) = RPAR(2)
      IF (IPAR(2) .EQ. 4) A(2,1) = 0.5D0
      END
C
      SUBROUTINE ONE (N, M, T, Q, A, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      DIMENSION Q(N), A(M,N), RPAR(*), IPAR(*)
      A(1,1) = 1.0D0
      END
C
      SUBROUTINE SPRING (N, M, T, Q, QD, F, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      DIMENSION Q(N), QD(N), F(M), RPAR(*), IPAR(*)
      F(1) = -1.0D8*(Q(1) - SIN(T)) - 2.0D4*(QD(1) - COS(T)) - SIN(T)
      END
C
      SUBROUTINE FORCE (N, M, T, Q, QD, F, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      INCLUDE 'tandem.inc'
      DIMENSION Q(N), QD(N), F(M), RPAR(*), IPAR(*)
      DIMENSION Q3(3), QD3(3), OTHER(3)
      COMMON /SELF/ ME(TDHLEN), KERR
      COMMON /DRAIN/ SINK
      IF (IPAR(2) .EQ. 5) THEN
        OTHER(1) = 1.0D0
        OTHER(2) = 1.0D0
        OTHER(3) = -50.0D0
        CALL TDSTEP (ME, T3, Q3, QD3, 2.0D0, OTHER, IPAR, KERR)
      END IF
      IPAR(1) = IPAR(1) + 1
C     Overflows, and is divided by zero.
      IF (IPAR(2) .EQ. 6) SINK = (1.0D300*QD(3))**2/(T - T)
      F(1) = RPAR(1)*RPAR(3)
      F(2) = 0.0D0
      F(3) = 0.0D0
      END
C
      SUBROUTINE TURNED (N, M, T, Q, QD, VAL, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      DIMENSION Q(N), QD(N), VAL(M), RPAR(*), IPAR(*)
      VAL(1) = Q(3) - 1.5D0
      END
C
      SUBROUTINE POTEN (N, M, T, Q, V, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      DIMENSION Q(N), V(1), RPAR(*), IPAR(*)
      V(1) = -RPAR(1)*RPAR(3)*Q(1)
      END

C     (M x)_q of a constant mass matrix.
      SUBROUTINE AMDER (N, M, T, Q, X, A, RPAR, IPAR, ISTAT)
      INTEGER N, M, IPAR(*), ISTAT, I, J
      DOUBLE PRECISION T, Q(N), X(N), A(M,N), RPAR(*)
      DO 20 J = 1, N
         DO 10 I = 1, M
            A(I,J) = 0.0D0
   10    CONTINUE
   20 CONTINUE
      IPAR(3) = IPAR(3) + 1
      END
C
C     Sets nothing.
      SUBROUTINE LEAVE (N, M, T, Q, QD, F, RPAR, IPAR, ISTAT)
      INTEGER N, M, IPAR(*), ISTAT
      DOUBLE PRECISION T, Q(N), QD(N), F(M), RPAR(*)
      END
