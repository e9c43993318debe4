C     SPDX-License-Identifier: MIT
C
C     A point mass on a string of 1 m, from the horizontal at rest: a
C     mechanism, described by keys, without any subroutine of its own.
C     Its motion is an elliptic function; at t = 10 the values below
C     are known from it (A01 of the benchmarks of the IFToMM).
C
      PROGRAM SWING
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      INCLUDE 'tandem.inc'
      PARAMETER (NMAX = 10)
      DIMENSION IH(TDHLEN), Q(NMAX), QD(NMAX), G(2), EXACT(2)
      DIMENSION RPAR(1), IPAR(1)
      CHARACTER*(TDTLEN) TEXT
      CHARACTER*20 NAME
      DATA G /0.0D0, -9.81D0/
      DATA EXACT /-0.27508746257611686D0, -0.96141920509912506D0/
      T = 0.0D0
C
C     Each key that is refused leaves a text; TDDEFN refuses what is
C     then missing.
      CALL TDMECH (IH, IERR)
      CALL TDKVEC (IH, 'gravity.vector', 2, G, IERR)
      CALL TDKNUM (IH, 'body.bob.mass', 1.0D0, IERR)
      CALL TDKEY  (IH, 'body.bob.position', '[-1, 0]', IERR)
      CALL TDKTXT (IH, 'constraint.string.type', 'distance', IERR)
      CALL TDKEY  (IH, 'constraint.string.between',
     &             '["ground", "bob"]', IERR)
      CALL TDDEFN (IH, 1, 0, 0.0D0, 10.0D0, IERR)
      IF (IERR .NE. 0) GO TO 900
      CALL TDSIZE (IH, N, NH, ND, IERR)
      CALL TDDRAW (IH, Q, QD, IERR)
      CALL TDSETR (IH, 'rtol', 1.0D-10, IERR)
      IF (IERR .NE. 0) GO TO 900
      CALL TDSETS (IH, 'stepper', 'dop853', IERR)
      IF (IERR .NE. 0) GO TO 900
      CALL TDSTRT (IH, T, Q, QD, RPAR, IPAR, IERR)
      IF (IERR .NE. 0) GO TO 900
      CALL TDINTG (IH, T, Q, QD, 10.0D0, RPAR, IPAR, IERR)
      IF (IERR .NE. 0) GO TO 900
      ERR = 0.0D0
      DO 10 I = 1, N
        CALL TDNAME (IH, 'coordinate', I, NAME, IERR)
        WRITE (*, '(A, F20.15)') NAME, Q(I)
        ERR = MAX (ERR, ABS (Q(I) - EXACT(I)))
   10 CONTINUE
      WRITE (*, '(A, ES9.1)') 'error:', ERR
      CALL TDFREE (IH, IERR)
      STOP
  900 CALL TDTEXT (IH, TEXT)
      WRITE (*, '(2A)') 'swing: ', TEXT(1:LEN_TRIM (TEXT))
      STOP 1
      END
