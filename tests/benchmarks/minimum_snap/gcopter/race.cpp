// Time-optimal flights through gates with GCOPTER, for the benchmark beside this file.
//
// Compile with -I PEERS -I EIGEN, where PEERS contains gcopter/gcopter.hpp. Gates replace the overlaps
// of the corridor: GCOPTER keeps its knots inside the convex hulls of `vPolytopes`, which the class
// computes from the corridor and which are set here, so that it needs no thin polytopes.
//
// Input, numbers separated by spaces: count of tracks; then per track the limits (speed, rate, tilt,
// low, high), mass, gravity, the weight of time, the weight of penalties, smoothing, instants, the
// tolerance, pieces per leg, repetitions; lower (3) and upper (3) corner of the world; start (3), goal
// (3), count of gates, and per gate the count of vertices and the vertices.
// Output per track: "track", least seconds of CPU of a call, pieces (0 after a failure), and per piece
// the duration and 18 coefficients, highest power first.

#include <ctime>
#include <iomanip>
#include <iostream>
#include <sstream>

#include <Eigen/Eigen>

#include "gcopter/geo_utils.hpp"
#include "gcopter/trajectory.hpp"

#define private public
#include "gcopter/gcopter.hpp"
#undef private

using Vector = Eigen::VectorXd;

static Eigen::Matrix3Xd read_points(int count)
{
    Eigen::Matrix3Xd points(3, count);
    for (int i = 0; i < count; i++)
        for (int j = 0; j < 3; j++)
            std::cin >> points(j, i);
    return points;
}

// GCOPTER's form of a convex hull: the first vertex, and the others relative to it.
static Eigen::Matrix3Xd hull(Eigen::Matrix3Xd points)
{
    Eigen::Matrix3Xd rest = points.rightCols(points.cols() - 1);
    points.rightCols(points.cols() - 1) = rest.colwise() - points.col(0);
    return points;
}

int main()
{
    int tracks;
    std::cin >> tracks;
    std::cout << std::setprecision(17);
    for (int track = 0; track < tracks; track++)
    {
        Vector bounds(5), penalties(5), physical(6);
        double mass, gravity, rho, penalty, smoothing, tolerance;
        int instants, pieces, repetitions, gates;
        for (int i = 0; i < 5; i++)
            std::cin >> bounds(i);
        std::cin >> mass >> gravity >> rho >> penalty >> smoothing >> instants >> tolerance >> pieces >>
            repetitions;
        const Eigen::Matrix3Xd world = read_points(2);
        penalties.setConstant(penalty);
        physical << mass, gravity, 0.0, 0.0, 0.0, 1.0e-4;
        Eigen::Matrix3d head = Eigen::Matrix3d::Zero(), tail = Eigen::Matrix3d::Zero();
        head.col(0) = read_points(1);
        tail.col(0) = read_points(1);
        std::cin >> gates;
        std::vector<Eigen::Matrix3Xd> polygons;
        for (int i = 0; i < gates; i++)
        {
            int count;
            std::cin >> count;
            polygons.push_back(read_points(count));
        }
        Eigen::MatrixX4d box(6, 4);
        box << Eigen::Matrix3d::Identity(), -world.col(1), -Eigen::Matrix3d::Identity(), world.col(0);
        Eigen::Matrix3Xd corners(3, 8);
        for (int i = 0; i < 8; i++)
            for (int j = 0; j < 3; j++)
                corners(j, i) = world(j, i >> j & 1);
        double best = INFINITY;
        Trajectory<5> flight;
        for (int run = 0; run < repetitions; run++)
        {
            gcopter::GCOPTER_PolytopeSFC planner;
            const std::clock_t begin = std::clock();
            const int legs = gates + 1, count = legs * pieces;
            planner.rho = rho;
            planner.headPVA = head;
            planner.tailPVA = tail;
            planner.hPolytopes.assign(1, box);
            planner.vPolytopes.clear();
            planner.vPolytopes.push_back(hull(corners));
            for (int i = 0; i < gates; i++)
            {
                planner.vPolytopes.push_back(hull(polygons[i]));
                planner.vPolytopes.push_back(planner.vPolytopes[0]);
            }
            planner.polyN = legs;
            planner.smoothEps = smoothing;
            planner.integralRes = instants;
            planner.magnitudeBd = bounds;
            planner.penaltyWt = penalties;
            planner.physicalPm = physical;
            planner.allocSpeed = bounds(0) * 3.0;
            planner.getShortestPath(head.col(0), tail.col(0), planner.vPolytopes, smoothing, planner.shortPath);
            planner.pieceIdx = Eigen::VectorXi::Constant(legs, pieces);
            planner.pieceN = planner.temporalDim = count;
            planner.spatialDim = 0;
            planner.vPolyIdx.resize(count - 1);
            planner.hPolyIdx.setZero(count);
            for (int i = 0, j = 0; i < legs; i++)
                for (int l = 0; l < pieces; l++, j++)
                    if (j < count - 1)
                    {
                        planner.vPolyIdx(j) = l < pieces - 1 ? 2 * i : 2 * i + 1;
                        planner.spatialDim += planner.vPolytopes[planner.vPolyIdx(j)].cols();
                    }
            planner.minco.setConditions(head, tail, count);
            planner.flatmap.reset(mass, gravity, 0.0, 0.0, 0.0, 1.0e-4);
            planner.points.resize(3, count - 1);
            planner.times.resize(count);
            planner.gradByPoints.resize(3, count - 1);
            planner.gradByTimes.resize(count);
            planner.partialGradByCoeffs.resize(6 * count, 3);
            planner.partialGradByTimes.resize(count);
            planner.optimize(flight, tolerance);
            best = std::min(best, double(std::clock() - begin) / CLOCKS_PER_SEC);
        }
        std::cout << "track " << best << " " << flight.getPieceNum();
        for (int i = 0; i < flight.getPieceNum(); i++)
        {
            std::cout << " " << flight[i].getDuration();
            const auto &coefficients = flight[i].getCoeffMat();
            for (int j = 0; j < 3; j++)
                for (int k = 0; k < 6; k++)
                    std::cout << " " << coefficients(j, k);
        }
        std::cout << std::endl;
    }
}
