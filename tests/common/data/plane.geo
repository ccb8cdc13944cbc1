// Two bodies side by side: "water" of triangles, 2 m x 1 m, and "wall" of quadrilaterals, a trapezium of 0.75 m^2.
// The water's outline runs clockwise on purpose: its triangles come with negative area. Made with gmsh 4.8:
//   for f in 22 41; do gmsh -2 plane.geo -format msh$f -o plane_$f.msh; gmsh -2 plane.geo -format msh$f -bin -o plane_${f}b.msh; done
h = 0.5;
Point(1) = {0, 0, 0, h};
Point(2) = {2, 0, 0, h};
Point(3) = {2, 1, 0, h};
Point(4) = {0, 1, 0, h};
Point(5) = {2.5, 0, 0, h};
Point(6) = {3, 1, 0, h};
Point(9) = {7, 7, 0, h}; // of no body
Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 4};
Line(4) = {4, 1};
Line(5) = {2, 5};
Line(6) = {5, 6};
Line(7) = {6, 3};
Curve Loop(1) = {-4, -3, -2, -1};
Curve Loop(2) = {5, 6, 7, -2};
Plane Surface(1) = {1};
Plane Surface(2) = {2};
Transfinite Curve {2, 6} = 4;
Transfinite Curve {5, 7} = 3;
Transfinite Surface {2};
Recombine Surface {2};
Physical Surface("water") = {1};
Physical Surface("wall") = {2};
Physical Curve("wet") = {2};
Physical Curve("bottom") = {-1};
Physical Curve("outside of the wall") = {5, 6, -7};
Physical Point("corner") = {6};
Physical Curve(77) = {3};
