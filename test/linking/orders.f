C     SPDX-License-Identifier: MIT
C
C     The calls of the Fortran 77 interface in random order on a knife
C     edge by procedures, a point mass on a string by keys before and
C     after TDDEFN, sizes that are refused, and handles that were given
C     back: every call must end in a status with its text, and refuse
C     what the state of the problem does not allow. orders.c does the
C     same for C, with more faults in the arguments.
C
      PROGRAM ORDERS
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      INCLUDE 'tandem.inc'
      PARAMETER (NSLOT = 4, NCALL = 44, NTRIES = 6000)
      DIMENSION IH(TDHLEN,NSLOT), KIND(NSLOT), KN(NSLOT)
      DIMENSION NEED(NCALL)
      LOGICAL ALIVE(NSLOT), DEFD(NSLOT), RUNS(NSLOT), WRONG
      CHARACTER*200 TEXT
      CHARACTER*22 NAMES(0:21)
      COMMON /SEED/ ISEED
C     1: a problem, 2: procedures, 3: a complete model, 4: keys,
C     5: a complete mechanism, 6: a run.
      DATA NEED /2, 2, 2, 2, 1, 1, 1, 1, 2, 1,   1, 1, 6, 6, 6, 6, 6, 2,
     &           3, 3, 6, 6, 6, 6, 6, 6, 6, 6,   6, 6, 3, 3, 3, 4, 4, 4,
     &           4, 4, 1, 5, 5, 5, 5, 1/
      DATA NAMES /'ok', 'invalid_option', 'invalid_model',
     &  'inconsistent_start', 'rank_deficient', 'singular_mass',
     &  'callback_failed', 'not_evaluable', 'not_finite',
     &  'position_diverged', 'chart_left', 'constraints_not_held',
     &  'step_underflow', 'step_limit', 'output_failed',
     &  'newton_failed', 'inconsistent_rows', 'event_limit',
     &  'work_limit', 'invalid_checkpoint', 'interrupted',
     &  'no_equilibrium'/
      ISEED = 20240229
      NFAIL = 0
      NREF = 0
      NRUN = 0
      NDEF = 0
      DO 10 K = 1, NSLOT
        CALL RENEW (IH(1,K), KIND(K), KN(K), ALIVE(K), DEFD(K), RUNS(K))
   10 CONTINUE
      DO 20 I = 1, NTRIES
        K = NRAND (NSLOT)
        NGIVE = NRAND (40)
        NNEW = NRAND (4)
        IF (ALIVE(K) .AND. NGIVE .EQ. 1) THEN
          IF (NRAND (2) .EQ. 1) THEN
            CALL TDFREE (IH(1,K), IERR)
          ELSE
C           A copy of the handle stays.
            CALL COPIED (IH(1,K), IERR)
          END IF
          ALIVE(K) = .FALSE.
          DEFD(K) = .FALSE.
          RUNS(K) = .FALSE.
        ELSE IF (.NOT. ALIVE(K) .AND. NNEW .EQ. 1) THEN
          CALL RENEW (IH(1,K), KIND(K), KN(K), ALIVE(K), DEFD(K),
     &                RUNS(K))
        END IF
        J = NRAND (NCALL)
        IF (NRAND (4) .EQ. 1) THEN
C         The one that leads on.
          J = 20
          IF (RUNS(K)) J = 20 + NRAND (2)
          IF (KIND(K) .EQ. 2 .AND. .NOT. DEFD(K)) THEN
            J = 34
            IF (NRAND (8) .EQ. 1) J = 38
          END IF
        END IF
        CALL ONE (J, IH(1,K), KIND(K), DEFD(K), KN(K), IERR)
        CALL TDTEXT (IH(1,K), TEXT)
        WRONG = IERR .GT. 0 .OR. IERR .LT. -21
        IF (.NOT. WRONG) THEN
          L = LEN_TRIM (NAMES(-IERR))
          WRONG = TEXT(:L+1) .NE. NAMES(-IERR)(:L)//':'
        END IF
        IF (WRONG) CALL SAY (J, IERR, 'no status with its text', TEXT,
     &                       NFAIL)
        IF (IERR .NE. 0) NREF = NREF + 1
        WRONG = .NOT. ALIVE(K)
     &    .OR. (NEED(J) .EQ. 6 .AND. .NOT. RUNS(K))
     &    .OR. (NEED(J) .EQ. 2 .AND. KIND(K) .EQ. 2)
     &    .OR. (NEED(J) .EQ. 3 .AND. (KIND(K) .EQ. 3 .OR.
     &          (KIND(K) .EQ. 2 .AND. .NOT. DEFD(K))))
     &    .OR. (NEED(J) .EQ. 4 .AND. (KIND(K) .NE. 2 .OR. DEFD(K)))
     &    .OR. (NEED(J) .EQ. 5 .AND. .NOT. DEFD(K))
        IF (WRONG .AND. IERR .NE. TDEOPT .AND. IERR .NE. TDEMOD)
     &    CALL SAY (J, IERR, 'not refused in this state', TEXT, NFAIL)
        IF (.NOT. ALIVE(K)) GO TO 20
        IF (J .EQ. 38 .AND. IERR .EQ. 0) THEN
          DEFD(K) = .TRUE.
          NDEF = NDEF + 1
        END IF
        IF (J .EQ. 20 .AND. IERR .EQ. 0) NRUN = NRUN + 1
C       A call that only looks tells if there is a run now.
        CALL TDNEVT (IH(1,K), N, IERR2)
        RUNS(K) = IERR2 .EQ. 0
        IF (J .EQ. 20 .AND. ((IERR .EQ. 0) .NEQV. RUNS(K))) CALL SAY
     &     (J, IERR, 'another state of the run', TEXT, NFAIL)
        IF (J .LE. 4 .AND. IERR .EQ. 0 .AND. RUNS(K)) CALL SAY (J,
     &      IERR, 'a run goes on with another model', TEXT, NFAIL)
   20 CONTINUE
      DO 30 K = 1, NSLOT
        CALL TDFREE (IH(1,K), IERR)
   30 CONTINUE
      WRITE (*, '(A,4(I6,A))') '#', NTRIES, ' calls,', NREF,
     &  ' refused,', NRUN, ' runs,', NDEF, ' mechanisms'
      IF (NRUN .LT. 20 .OR. NDEF .LT. 5) THEN
        WRITE (*, '(A)') 'not ok orders-reach-all-states'
        NFAIL = NFAIL + 1
      END IF
      IF (NFAIL .GT. 0) THEN
        WRITE (*, '(A)') 'not ok calls-in-random-order'
        STOP 1
      END IF
      WRITE (*, '(A)') 'ok calls-in-random-order'
      END
C
C     From 1 to N, by the generator of Park and Miller (1988).
      INTEGER FUNCTION NRAND (N)
      COMMON /SEED/ ISEED
      ISEED = 16807*MOD (ISEED, 127773) - 2836*(ISEED/127773)
      IF (ISEED .LE. 0) ISEED = ISEED + 2147483647
      NRAND = 1 + MOD (ISEED/1024, N)
      END
C
      SUBROUTINE SAY (J, IERR, WHAT, TEXT, NFAIL)
      CHARACTER*(*) WHAT, TEXT
      NFAIL = NFAIL + 1
      IF (NFAIL .GT. 10) RETURN
      WRITE (*, '(A,I3,A,I4,4A)') 'not ok call', J, ', status', IERR,
     &  ', ', WHAT, ': ', TEXT
      END
C
C     Give a problem back by a copy of its handle.
      SUBROUTINE COPIED (IH, IERR)
      INCLUDE 'tandem.inc'
      DIMENSION IH(TDHLEN), JH(TDHLEN)
      DO 10 I = 1, TDHLEN
        JH(I) = IH(I)
   10 CONTINUE
      CALL TDFREE (JH, IERR)
      END
C
C     A problem: 1 by procedures, 2 a mechanism, 3 of wrong sizes.
      SUBROUTINE RENEW (IH, KIND, N, ALIVE, DEFD, RUNS)
      INCLUDE 'tandem.inc'
      DIMENSION IH(TDHLEN)
      LOGICAL ALIVE, DEFD, RUNS
      EXTERNAL EDGE, GAMMA, AMASS, FORCE
      ALIVE = .TRUE.
      DEFD = .FALSE.
      RUNS = .FALSE.
      KIND = NRAND (3)
      N = 0
      IF (KIND .EQ. 1) THEN
        N = 3
        CALL TDNEW (IH, 3, 0, 1, IERR)
        CALL TDPOS (IH, 'nonholonomic_jacobian', EDGE, IERR)
        CALL TDMOT (IH, 'constraint_acceleration', GAMMA, IERR)
        CALL TDPOS (IH, 'mass_matrix', AMASS, IERR)
        CALL TDMOT (IH, 'applied_force', FORCE, IERR)
      ELSE IF (KIND .EQ. 2) THEN
        CALL TDMECH (IH, IERR)
      ELSE
        CALL TDNEW (IH, NRAND (3) - 2, NRAND (3), 0, IERR)
      END IF
C     No run takes long.
      CALL TDSETI (IH, 'max_steps', 60, IERR)
      CALL TDSETR (IH, 'step', 1.0D-2, IERR)
      END
C
C     The call J.
      SUBROUTINE ONE (J, IH, KIND, DEFD, N, IERR)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      INCLUDE 'tandem.inc'
      PARAMETER (MSAVE = 40000)
      DIMENSION IH(TDHLEN), Q(8), QD(8), QDD(8), RE(8), AIM(8), A(64)
      DIMENSION ISAVE(MSAVE), RPAR(1), IPAR(1), X(3)
      CHARACTER*60 TEXT
      CHARACTER*26 KEYS(5), VALUES(5)
      LOGICAL DEFD
      EXTERNAL EDGE, GAMMA, AMASS, FORCE, TURNED, PASSED, SEVERL
      SAVE ISAVE, LSAVE, RPAR, IPAR
      DATA LSAVE /0/, RPAR /0.0D0/, IPAR /0/
      DATA KEYS /'gravity.vector', 'body.bob.mass',
     &  'body.bob.position', 'constraint.string.type',
     &  'constraint.string.between'/
      DATA VALUES /'[0, -9.81]', '1', '[-1, 0]', '"distance"',
     &  '["ground", "bob"]'/
      DO 1 I = 1, 8
        Q(I) = 0.0D0
        QD(I) = 0.0D0
    1 CONTINUE
      QD(3) = 1.5D0
      IF (KIND .EQ. 2 .AND. DEFD) CALL TDDRAW (IH, Q, QD, IERR)
C     Now and then what is not a number.
      IF (NRAND (8) .EQ. 1) Q(NRAND (3)) = LOG (QD(3) - 2.0D0)
      T = 0.0D0
      IF (NRAND (4) .EQ. 1) T = -1.0D0
      CALL TDGTIM (IH, T)
      T2 = T + 0.01D0*(NRAND (9) - 2)
      IF (NRAND (20) .EQ. 1) T2 = 1.0D300
      I = NRAND (6) - 2
      X(1) = T2
      X(2) = 1.0D0
      X(3) = 2.0D0
      GO TO (101, 102, 103, 104, 105, 106, 107, 108, 109, 110, 111, 112,
     &       113, 114, 115, 116, 117, 118, 119, 120, 121, 122, 123, 124,
     &       125, 126, 127, 128, 129, 130, 131, 132, 133, 134, 135, 136,
     &       137, 138, 139, 140, 141, 142, 143, 144), J
  101 CALL TDPOS (IH, 'mass_matrix', AMASS, IERR)
      RETURN
  102 CALL TDMOT (IH, 'applied_force', FORCE, IERR)
      RETURN
  103 CALL TDDIR (IH, 'mass_derivative', TURNED, IERR)
      IF (IERR .EQ. 0) CALL TDDIR (IH, 'mass_derivative', TDNONE, IERR)
      RETURN
  104 CALL TDEVAL (IH, SEVERL, TDMASS, IERR)
      IF (IERR .EQ. 0) CALL TDEVAL (IH, TDNONE, I, IERR)
      RETURN
  105 CALL TDSETR (IH, 'atol', 1.0D-3*I, IERR)
      RETURN
  106 CALL TDSETI (IH, 'max_events', I, IERR)
      RETURN
  107 IF (I .GT. 1) CALL TDSETS (IH, 'stepper', 'rk4', IERR)
      IF (I .LE. 1) CALL TDSETS (IH, 'stepper', 'sdirk54', IERR)
      RETURN
  108 CALL TDSETV (IH, 'weight_q', MIN (I, 3), X, IERR)
      RETURN
  109 CALL TDROW (IH, I, 'edge', IERR)
      RETURN
  110 CALL TDEVNT (IH, 'e'//CHAR (64 + NRAND (20)), 'q', I, T2,
     &             NRAND (4) - 2, NRAND (2) - 1, IERR)
      RETURN
  111 CALL TDEVFN (IH, 'f'//CHAR (64 + NRAND (20)), PASSED,
     &             NRAND (3) - 2, NRAND (2) - 1, IERR)
      RETURN
  112 CALL TDEVCL (IH, IERR)
      RETURN
  113 CALL TDNEVT (IH, K, IERR)
      RETURN
  114 CALL TDGEVT (IH, I, NUMBER, IDIR, T, Q, QD, IERR)
      RETURN
  115 CALL TDSTOP (IH, NUMBER, IERR)
      RETURN
  116 CALL TDWERR (IH, T2, IERR)
      RETURN
  117 CALL TDEERR (IH, RPAR, IPAR, IERR)
      RETURN
  118 CALL TDCHCK (IH, T2, Q, QD, RPAR, IPAR, IERR)
      RETURN
  119 CALL TDASSM (IH, T, Q, QD, RPAR, IPAR, IERR)
      RETURN
  120 CALL TDSTRT (IH, 0.0D0, Q, QD, RPAR, IPAR, IERR)
      RETURN
  121 CALL TDINTG (IH, T, Q, QD, T2, RPAR, IPAR, IERR)
      RETURN
  122 CALL TDSTEP (IH, T, Q, QD, T2, RPAR, IPAR, IERR)
      RETURN
  123 CALL TDDENS (IH, T2, Q, QD, QDD, RPAR, IPAR, IERR)
      RETURN
  124 CALL TDLAMB (IH, T2, Q, RPAR, IPAR, IERR)
      RETURN
  125 CALL TDENER (IH, EKIN, EPOT, RPAR, IPAR, IERR)
      RETURN
  126 CALL TDSTAT (IH, 'steps', VALUE, IERR)
      RETURN
  127 CALL TDNWRN (IH, K, IERR)
      RETURN
  128 CALL TDWARN (IH, I, TEXT, IERR)
      RETURN
  129 CALL TDSAVE (IH, MSAVE*MOD (I + 2, 2), ISAVE, K, IERR)
      IF (IERR .EQ. 0 .AND. MOD (I + 2, 2) .EQ. 1) LSAVE = K
      RETURN
  130 CALL TDREST (IH, LSAVE - MAX (I - 3, 0), ISAVE, IERR)
      RETURN
  131 CALL TDLIN (IH, T2, Q, QD, K, RE, AIM, A, RPAR, IPAR, IERR)
      RETURN
  132 CALL TDEQUI (IH, T2, Q, RPAR, IPAR, IERR)
      RETURN
  133 CALL TDSTDY (IH, T2, Q, QD, ' ', RPAR, IPAR, IERR)
      RETURN
  134 K = NRAND (5)
      CALL TDKEY (IH, KEYS(K), VALUES(K), IERR)
      RETURN
  135 CALL TDKNUM (IH, 'body.bob.mass', X(2), IERR)
      RETURN
  136 CALL TDKTXT (IH, 'constraint.string.type', 'distance', IERR)
      RETURN
  137 CALL TDKVEC (IH, 'gravity.vector', MIN (I, 2), X(2), IERR)
      RETURN
  138 CALL TDDEFN (IH, 1, NRAND (2) - 1, 0.0D0, T2, IERR)
      RETURN
  139 CALL TDSIZE (IH, K, NH, ND, IERR)
      RETURN
  140 CALL TDDRAW (IH, Q, QD, IERR)
      RETURN
  141 CALL TDNAME (IH, 'coordinate', I, TEXT, IERR)
      RETURN
  142 CALL TDNAME (IH, 'row', I, TEXT, IERR)
      RETURN
  143 CALL TDNAME (IH, 'nothing', I, TEXT, IERR)
      RETURN
  144 CALL TDSEGM (IH, K)
      CALL TDSIZE (IH, K, NH, ND, IERR)
      END
C
C     The time of a run; unchanged where there is none. Its state is
C     what a look at no events leaves alone.
      SUBROUTINE TDGTIM (IH, T)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      INCLUDE 'tandem.inc'
      DIMENSION IH(TDHLEN)
      CALL TDSTAT (IH, 'steps', STEPS, IERR)
      IF (IERR .EQ. 0) T = 1.0D-2*STEPS
      END
C
C     A knife edge at (x, y) with the angle phi.
      SUBROUTINE EDGE (N, M, T, Q, VAL, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      DIMENSION Q(N), VAL(M,N), RPAR(*), IPAR(*)
      VAL(1,1) = SIN (Q(3))
      VAL(1,2) = -COS (Q(3))
      VAL(1,3) = 0.0D0
      END
C
      SUBROUTINE GAMMA (N, M, T, Q, QD, VAL, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      DIMENSION Q(N), QD(N), VAL(M), RPAR(*), IPAR(*)
      VAL(1) = QD(3)*(COS (Q(3))*QD(1) + SIN (Q(3))*QD(2))
      END
C
      SUBROUTINE AMASS (N, M, T, Q, VAL, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      DIMENSION Q(N), VAL(M,N), RPAR(*), IPAR(*)
      DO 20 J = 1, N
        DO 10 I = 1, M
          VAL(I,J) = 0.0D0
   10   CONTINUE
        VAL(J,J) = 2.0D0
   20 CONTINUE
      VAL(3,3) = 0.2D0
      END
C
      SUBROUTINE FORCE (N, M, T, Q, QD, VAL, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      DIMENSION Q(N), QD(N), VAL(M), RPAR(*), IPAR(*)
      VAL(1) = 5.0D0
      VAL(2) = 0.0D0
      VAL(3) = 0.0D0
      END
C
      SUBROUTINE TURNED (N, M, T, Q, X, VAL, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      DIMENSION Q(N), X(N), VAL(M,N), RPAR(*), IPAR(*)
      ISTAT = 1
      END
C
      SUBROUTINE SEVERL (NEED, N, NH, ND, T, Q, QD, PHI, C, ANU, GAM,
     &                   AM, F, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      DIMENSION Q(N), QD(N), PHI(*), C(*), ANU(*), GAM(*), AM(*), F(*)
      DIMENSION RPAR(*), IPAR(*)
      ISTAT = 1
      END
C
      SUBROUTINE PASSED (N, M, T, Q, QD, VAL, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      DIMENSION Q(N), QD(N), VAL(M), RPAR(*), IPAR(*)
      VAL(1) = Q(1) - 0.1D0
      END
