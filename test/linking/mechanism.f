C     SPDX-License-Identifier: MIT
C
C     Tests of mechanisms by keys from Fortran 77: "ok NAME" or
C     "not ok NAME" for each. A point mass on a string of 1 m, from the
C     horizontal at rest.
C
      PROGRAM TESTS
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      INCLUDE 'tandem.inc'
      DIMENSION IH(TDHLEN), JH(TDHLEN), Q(2), QD(2), G(2)
      DIMENSION RPAR(1), IPAR(1)
      CHARACTER*200 TEXT
      DATA G /0.0D0, -9.81D0/
      NFAIL = 0
      CALL TDMECH (IH, IERR)
      CALL TOLD ('a-mechanism-is-begun', IERR .EQ. 0, NFAIL)
      CALL TDSIZE (IH, N, NH, ND, IERR)
      CALL TOLD ('without-a-size', N .EQ. 0 .AND. IERR .EQ. 0, NFAIL)
      CALL TDDRAW (IH, Q, QD, IERR)
      CALL TDTEXT (IH, TEXT)
      CALL TOLD ('which-is-not-complete', IERR .EQ. TDEOPT .AND.
     &           INDEX (TEXT, 'call TDDEFN after') .GT. 0, NFAIL)
C     A number, a list, a text, and values as scene files have them.
      CALL TDKVEC (IH, 'gravity.vector', 2, G, IERR)
      CALL TOLD ('a-list-is-given', IERR .EQ. 0, NFAIL)
      CALL TDKNUM (IH, 'body.bob.mass  ', 1.0D0, IERR)
      CALL TOLD ('a-number-is-given', IERR .EQ. 0, NFAIL)
      CALL TDKEY (IH, 'body.bob.position', '[-1, "0*2"]   ', IERR)
      CALL TOLD ('a-value-is-given', IERR .EQ. 0, NFAIL)
      CALL TDKTXT (IH, 'constraint.string.type', 'distance  ', IERR)
      CALL TOLD ('a-text-is-given', IERR .EQ. 0, NFAIL)
      CALL TDKEY (IH, 'constraint.string.between', '["ground",', IERR)
      CALL TDTEXT (IH, TEXT)
      CALL TOLD ('half-a-list-is-refused', IERR .EQ. TDEOPT .AND.
     &           INDEX (TEXT, 'constraint.string.between') .GT. 0,
     &           NFAIL)
      CALL TDKVEC (IH, 'gravity.vector', -1, G, IERR)
      CALL TOLD ('a-negative-length-is-refused', IERR .EQ. TDEOPT,
     &           NFAIL)
      CALL TDKNUM (IH, 'body.bob.mass', LOG (-ABS (G(2))), IERR)
      CALL TOLD ('what-is-no-number-is-refused', IERR .EQ. TDEOPT,
     &           NFAIL)
      CALL TDKNUM (IH, '   ', 1.0D0, IERR)
      CALL TOLD ('an-empty-key-is-refused', IERR .EQ. TDEOPT, NFAIL)
      CALL TDDEFN (IH, 1, 0, 0.0D0, 10.0D0, IERR)
      CALL TDTEXT (IH, TEXT)
      CALL TOLD ('a-missing-key-is-named', IERR .NE. 0 .AND.
     &           INDEX (TEXT, 'between') .GT. 0, NFAIL)
C     It can be mended.
      CALL TDKEY (IH, 'constraint.string.between',
     &            '["ground", "bob"]', IERR)
      CALL TDDEFN (IH, 1, 0, 0.0D0, 10.0D0, IERR)
      CALL TDTEXT (IH, TEXT)
      IF (IERR .NE. 0) WRITE (*, '(4X, A)') TEXT
      CALL TOLD ('it-is-built', IERR .EQ. 0, NFAIL)
      CALL TDSIZE (IH, N, NH, ND, IERR)
      CALL TOLD ('with-its-sizes', N .EQ. 2 .AND. NH .EQ. 1 .AND.
     &           ND .EQ. 0, NFAIL)
      CALL TDDRAW (IH, Q, QD, IERR)
      CALL TOLD ('as-it-is-drawn', ABS(Q(1) + 1.0D0) + ABS(QD(2))
     &           .LT. 1.0D-15, NFAIL)
      CALL TDNAME (IH, 'coordinate', 2, TEXT, IERR)
      CALL TOLD ('a-coordinate-has-a-name', TEXT .EQ. 'bob.y', NFAIL)
      CALL TDNAME (IH, 'unit', 2, TEXT, IERR)
      CALL TOLD ('and-a-unit', TEXT .EQ. 'm', NFAIL)
      CALL TDNAME (IH, 'row', 1, TEXT, IERR)
      CALL TOLD ('a-row-has-a-name', INDEX (TEXT, 'string') .GT. 0,
     &           NFAIL)
      CALL TDNAME (IH, 'coordinate', 3, TEXT, IERR)
      CALL TOLD ('there-is-no-third-name', IERR .EQ. TDEOPT .AND.
     &           TEXT .EQ. ' ', NFAIL)
      CALL TDSETS (IH, 'stepper', 'dop853', IERR)
      CALL TDSETR (IH, 'rtol', 1.0D-11, IERR)
      T = 0.0D0
      CALL TDSTRT (IH, T, Q, QD, RPAR, IPAR, IERR)
      CALL TDINTG (IH, T, Q, QD, 10.0D0, RPAR, IPAR, IERR)
      CALL TOLD ('it-runs', IERR .EQ. 0, NFAIL)
C     Elliptic functions; 1e-9 is a hundred tolerances.
      CALL TOLD ('as-elliptic-functions-say',
     &           ABS(Q(1) + 0.27508746257611686D0) .LT. 1.0D-9 .AND.
     &           ABS(Q(2) + 0.96141920509912506D0) .LT. 1.0D-9, NFAIL)
      CALL TDKNUM (IH, 'body.bob.mass', 2.0D0, IERR)
      CALL TDTEXT (IH, TEXT)
      CALL TOLD ('a-key-that-comes-too-late', IERR .EQ. TDEOPT .AND.
     &           INDEX (TEXT, 'complete') .GT. 0, NFAIL)
      CALL TDFREE (IH, IERR)
      CALL TDKNUM (IH, 'body.bob.mass', 2.0D0, IERR)
      CALL TOLD ('what-was-given-back-is-refused', IERR .EQ. TDEOPT,
     &           NFAIL)
C     Keys are for mechanisms alone.
      CALL TDNEW (JH, 1, 0, 0, IERR)
      CALL TDKNUM (JH, 'body.bob.mass', 2.0D0, IERR)
      CALL TDTEXT (JH, TEXT)
      CALL TOLD ('another-problem-takes-no-keys', IERR .EQ. TDEOPT .AND.
     &           INDEX (TEXT, 'by TDMECH') .GT. 0, NFAIL)
      CALL TDFREE (JH, IERR)
      CALL STEADY (NFAIL)
      IF (NFAIL .GT. 0) STOP 1
      END
C
C     A bob on a string of 1 m that turns about the vertical at 4 rad/s
C     is 9.81/16 m below the pivot.
      SUBROUTINE STEADY (NFAIL)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      INCLUDE 'tandem.inc'
      DIMENSION IH(TDHLEN), Q(3), QD(3), G(3), RPAR(1), IPAR(1)
      CHARACTER*200 TEXT
      DATA G /0.0D0, 0.0D0, -9.81D0/
      CALL TDMECH (IH, IERR)
      CALL TDKVEC (IH, 'gravity.vector', 3, G, IERR)
      CALL TDKNUM (IH, 'body.bob.mass', 1.0D0, IERR)
      CALL TDKEY (IH, 'body.bob.position', '[0.6, 0, -0.8]', IERR)
      CALL TDKEY (IH, 'body.bob.velocity', '[0, 1.8, 0]', IERR)
      CALL TDKTXT (IH, 'constraint.string.type', 'distance', IERR)
      CALL TDKEY (IH, 'constraint.string.between',
     &            '["ground", "bob"]', IERR)
      CALL TDDEFN (IH, 0, 0, 0.0D0, 10.0D0, IERR)
      CALL TDDRAW (IH, Q, QD, IERR)
      CALL TOLD ('a-bob-on-a-string', IERR .EQ. 0, NFAIL)
      CALL TDSTDY (IH, 0.0D0, Q, QD, 'any world.rotation_z=4  ', RPAR,
     &             IPAR, IERR)
      CALL TOLD ('turns-at-a-rate-that-is-held', IERR .EQ. 0 .AND.
     &           ABS(Q(3) + 9.81D0/16.0D0) .LT. 1.0D-12 .AND.
     &           ABS(Q(1)*QD(2) - Q(2)*QD(1) - 4.0D0*(Q(1)**2 +
     &           Q(2)**2)) .LT. 1.0D-12, NFAIL)
      CALL TDSTDY (IH, 0.0D0, Q, QD, ' ', RPAR, IPAR, IERR)
      CALL TOLD ('and-stays-where-none-is-held', IERR .EQ. 0 .AND.
     &           ABS(Q(3) + 9.81D0/16.0D0) .LT. 1.0D-9, NFAIL)
      CALL TDSTDY (IH, 0.0D0, Q, QD, 'world.rotation', RPAR, IPAR, IERR)
      CALL TOLD ('along-a-group', IERR .EQ. 0, NFAIL)
      CALL TDSTDY (IH, 0.0D0, Q, QD, 'world.rotation_z=', RPAR, IPAR,
     &             IERR)
      CALL TDTEXT (IH, TEXT)
      CALL TOLD ('a-rate-that-is-none', IERR .EQ. TDEOPT .AND.
     &           INDEX (TEXT, 'not a number') .GT. 0, NFAIL)
      CALL TDFREE (IH, IERR)
      END
C
      SUBROUTINE TOLD (NAME, PASSED, NFAIL)
      CHARACTER*(*) NAME
      LOGICAL PASSED
      INTEGER NFAIL
      IF (PASSED) THEN
        WRITE (*, '(2A)') 'ok ', NAME
      ELSE
        WRITE (*, '(2A)') 'not ok ', NAME
        NFAIL = NFAIL + 1
      END IF
      END
