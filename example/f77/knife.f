C     SPDX-License-Identifier: MIT
C
C     A knife edge (a skate) on an inclined plane, in the style of
C     Fortran 77: x downhill, y across, the heading phi. It cannot slip
C     sideways,
C
C         sin(phi) xd - cos(phi) yd = 0,
C
C     and the motion is known in closed form (Neimark and Fufaev). The
C     caller keeps its time loop: tandem takes the steps, and the
C     states at the times of the table are dense output.
C
      PROGRAM KNIFE
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      INCLUDE 'tandem.inc'
      PARAMETER (N = 3)
      DIMENSION Q(N), QD(N), QT(N), QDT(N), QDDT(N), EXACT(N)
      DIMENSION RPAR(1), IPAR(2), IH(TDHLEN)
      CHARACTER*(TDTLEN) TEXT
      EXTERNAL EDGE, GAMMA, AMASS, FORCE
C     Mass, moment of inertia, downhill component of gravity.
      COMMON /PARAM/ AM, AJ, GX
      AM = 2.0D0
      AJ = 0.2D0
      GX = 9.81D0*SIN(0.3D0)
C     RPAR and IPAR are yours: here IPAR counts calls of FORCE.
      RPAR(1) = 0.0D0
C
C     The model: sizes and procedures by name.
      CALL TDNEW (IH, N, 0, 1, IERR)
      IF (IERR .NE. 0) GO TO 900
      CALL TDPOS (IH, 'NONHOLONOMIC_JACOBIAN', EDGE, IERR)
      IF (IERR .NE. 0) GO TO 900
      CALL TDMOT (IH, 'CONSTRAINT_ACCELERATION', GAMMA, IERR)
      IF (IERR .NE. 0) GO TO 900
      CALL TDPOS (IH, 'MASS_MATRIX', AMASS, IERR)
      IF (IERR .NE. 0) GO TO 900
      CALL TDMOT (IH, 'APPLIED_FORCE', FORCE, IERR)
      IF (IERR .NE. 0) GO TO 900
      CALL TDSETI (IH, 'CONSTANT_MASS', 1, IERR)
      IF (IERR .NE. 0) GO TO 900
C
C     The method, the tolerance, and the start: from rest, turning.
      CALL TDSETS (IH, 'STEPPER', 'DOP853', IERR)
      IF (IERR .NE. 0) GO TO 900
      CALL TDSETR (IH, 'RTOL', 1.0D-10, IERR)
      IF (IERR .NE. 0) GO TO 900
      T = 0.0D0
      DO 10 I = 1, N
        Q(I) = 0.0D0
        QD(I) = 0.0D0
   10 CONTINUE
      W = 1.5D0
      QD(3) = W
C     A wrong sign or entry, which the run may not notice.
      CALL TDCHCK (IH, T, Q, QD, RPAR, IPAR, IERR)
      IF (IERR .NE. 0) GO TO 900
      IPAR(1) = 0
      CALL TDSTRT (IH, T, Q, QD, RPAR, IPAR, IERR)
      IF (IERR .NE. 0) GO TO 900
C
C     The time loop: steps as the tolerance wants them, a table each
C     second.
      TEND = 10.0D0
      TOUT = 1.0D0
      ERRMAX = 0.0D0
   20 IF (T .GE. TEND) GO TO 50
        CALL TDSTEP (IH, T, Q, QD, TEND, RPAR, IPAR, IERR)
        IF (IERR .NE. 0) GO TO 900
   30   IF (TOUT .GT. T) GO TO 20
          CALL TDDENS (IH, TOUT, QT, QDT, QDDT, RPAR, IPAR, IERR)
          IF (IERR .NE. 0) GO TO 900
          A = GX/(4.0D0*W**2)
          B = 2.0D0*W*TOUT
          EXACT(1) = A*(1.0D0 - COS(B))
          EXACT(2) = A*(B - SIN(B))
          EXACT(3) = W*TOUT
          DO 40 I = 1, N
            ERRMAX = MAX(ERRMAX, ABS(QT(I) - EXACT(I)))
   40     CONTINUE
          WRITE (*, '(F6.1, 3F14.9)') TOUT, QT
          TOUT = TOUT + 1.0D0
        GO TO 30
C
   50 CALL TDSTAT (IH, 'STEPS', STEPS, IERR)
      IF (IERR .NE. 0) GO TO 900
      WRITE (*, '(A, I6)') 'steps: ', NINT(STEPS)
      WRITE (*, '(A, I6)') 'calls of FORCE: ', IPAR(1)
      WRITE (*, '(A, 1P, E9.1)') 'error: ', ERRMAX
      CALL TDFREE (IH, IERR)
      STOP
C
  900 CALL TDTEXT (IH, TEXT)
      WRITE (*, '(A)') TEXT
      STOP 1
      END
C
C     E(ND,N) of E qd = e: one row.
      SUBROUTINE EDGE (N, M, T, Q, E, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      DIMENSION Q(N), E(M,N), RPAR(*), IPAR(*)
      E(1,1) = SIN(Q(3))
      E(1,2) = -COS(Q(3))
      E(1,3) = 0.0D0
      END
C
C     gamma(NH+ND) of C qdd = -gamma: the rate of E at qdd = 0.
      SUBROUTINE GAMMA (N, M, T, Q, QD, G, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      DIMENSION Q(N), QD(N), G(M), RPAR(*), IPAR(*)
      G(1) = QD(3)*(COS(Q(3))*QD(1) + SIN(Q(3))*QD(2))
      END
C
C     M(N,N). T has no meaning here.
      SUBROUTINE AMASS (N, M, T, Q, A, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      DIMENSION Q(N), A(M,N), RPAR(*), IPAR(*)
      COMMON /PARAM/ AM, AJ, GX
      DO 20 J = 1, N
        DO 10 I = 1, N
          A(I,J) = 0.0D0
   10   CONTINUE
   20 CONTINUE
      A(1,1) = AM
      A(2,2) = AM
      A(3,3) = AJ
      END
C
C     The applied forces Q_A(N).
      SUBROUTINE FORCE (N, M, T, Q, QD, F, RPAR, IPAR, ISTAT)
      IMPLICIT DOUBLE PRECISION (A-H,O-Z)
      DIMENSION Q(N), QD(N), F(M), RPAR(*), IPAR(*)
      COMMON /PARAM/ AM, AJ, GX
      F(1) = AM*GX
      F(2) = 0.0D0
      F(3) = 0.0D0
      IPAR(1) = IPAR(1) + 1
      END
