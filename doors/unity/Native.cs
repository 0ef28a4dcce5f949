// Constants, structures and functions of sinew.h. Written by test `lists` of sinew-embed; do not edit.
using System;
using System.Runtime.InteropServices;

namespace Sinew
{
    /// <summary>Kinds of errors.</summary>
    public enum Code
    {
        /// <summary>No error.</summary>
        Ok = 0,
        /// <summary>An argument that cannot be used.</summary>
        Argument = 1,
        /// <summary>A mesh.</summary>
        Mesh = 2,
        /// <summary>A material.</summary>
        Material = 3,
        /// <summary>A scene file.</summary>
        Scene = 4,
        /// <summary>A step that could not be carried out; the state is that before it.</summary>
        Step = 5,
        /// <summary>What the machine or the build does not have.</summary>
        Backend = 6,
        /// <summary>A file.</summary>
        Io = 7,
        /// <summary>A snapshot.</summary>
        Snapshot = 8,
        /// <summary>A handle of something that is gone, of another kind or of another simulation.</summary>
        Handle = 9,
        /// <summary>Another call uses the simulation at this moment.</summary>
        Busy = 10,
        /// <summary>The engine panicked, now or before; the simulation can only be freed.</summary>
        Panic = 99,
    }

    /// <summary>Kinds of things that a handle may stand for.</summary>
    public enum Kind : uint
    {
        /// <summary>Kinds for `sinew_find`: a body.</summary>
        Body = 1,
        /// <summary>A constraint.</summary>
        Constraint = 2,
        /// <summary>A load.</summary>
        Load = 3,
        /// <summary>A pressure.</summary>
        Pressure = 4,
        /// <summary>A tool.</summary>
        Tool = 5,
        /// <summary>A pull.</summary>
        Pull = 6,
        /// <summary>A contact between bodies.</summary>
        Contact = 7,
        /// <summary>A thread.</summary>
        Thread = 8,
        /// <summary>A clip.</summary>
        Clip = 9,
    }

    /// <summary>What can be read of a body, thread or clip.</summary>
    public enum Quantity : uint
    {
        /// <summary>What `sinew_read` reads, three numbers a vertex: positions (m).</summary>
        Positions = 0,
        /// <summary>Displacements (m).</summary>
        Displacements = 1,
        /// <summary>Velocities (m/s).</summary>
        Velocities = 2,
        /// <summary>Elastic forces (N) at the state as it is.</summary>
        ElasticForces = 3,
        /// <summary>Forces (N) of gravity and loads in the last step.</summary>
        ExternalForces = 4,
        /// <summary>Forces (N) of tools, contact and pulls at the end of the last step.</summary>
        ContactForces = 5,
        /// <summary>One number a vertex: pressures (Pa) of contact.</summary>
        ContactPressures = 6,
        /// <summary>Masses (kg).</summary>
        Masses = 7,
        /// <summary>One number an element: volume over that at rest, of tetrahedra, then hexahedra.</summary>
        VolumeRatios = 8,
        /// <summary>Area over that at rest, of triangles of the membrane, then quadrilaterals.</summary>
        AreaRatios = 9,
        /// <summary>Of a body that tears, eight numbers: area (m^2, at rest) that tore, elements parted, vertices made,
        /// tears that began without a wound, largest mean principal stress (Pa) where it may tear, largest energy
        /// release (J/m^2), pieces, and way (m) that a tear may still go.</summary>
        Tear = 10,
        /// <summary>Of a thread or clip, seven numbers: largest tension (N), length (m), work of hands (J), energy (J)
        /// lost, points lost, 1 if it broke, 1 if the step did not converge.</summary>
        ThreadReport = 11,
        /// <summary>Of each point that holds a thread or clip, its number.</summary>
        ThreadHeld = 12,
        /// <summary>Where these points are (m), three numbers each.</summary>
        ThreadPoints = 13,
        /// <summary>Tension (N) from one of them to the next.</summary>
        ThreadTensions = 14,
        /// <summary>Distances (m) from one of them to the next: across a wound, how far apart its lips are
        /// there.</summary>
        ThreadSpans = 15,
        /// <summary>Free lengths (m) between them.</summary>
        ThreadFree = 16,
        /// <summary>Length (m) that slid through every point, held or not, towards the first.</summary>
        ThreadSlid = 17,
        /// <summary>Forces (N) on what holds its first and its last point, three numbers each.</summary>
        ThreadEnds = 18,
        /// <summary>Of a body with glue, three numbers: springs that hold, energy (J) in them, and energy (J) that was
        /// in those that blades have passed.</summary>
        Glue = 19,
    }

    /// <summary>What a tool does; several by `|`.</summary>
    [Flags]
    public enum ToolFlags : uint
    {
        None = 0,
        /// <summary>Flags of tools: what touches it does not slip.</summary>
        Grip = 1,
        /// <summary>No penetration (integrators "newton" and "quasi-static").</summary>
        Exact = 2,
        /// <summary>Finds how its force answers to small motions.</summary>
        LocalStiffness = 4,
        /// <summary>Points inside leave through the nearest side, not through that by which they came.</summary>
        NearestSide = 8,
        /// <summary>Also finds the force that points of the other kind give. It is no bound on the error.</summary>
        ErrorBar = 16,
        /// <summary>Its parts are cavities: bodies may not leave their inside.</summary>
        Cavity = 32,
    }

    /// <summary>What is not as it should be with a haptic force; several by `|`.</summary>
    [Flags]
    public enum HapticFlags : uint
    {
        None = 0,
        /// <summary>Flags of `sinew_haptic_feedback`, several by `|`. No step has answered yet: no force.</summary>
        HapticWaiting = 1,
        /// <summary>The last step is too old: the force falls, or is zero.</summary>
        HapticStale = 2,
        /// <summary>Force or torque was cut to its limit.</summary>
        HapticLimited = 4,
        /// <summary>The force rises no faster than 50 N/s, a torque by as much of its limit: first contact, or the
        /// simulation answers again.</summary>
        HapticRising = 8,
        /// <summary>The device has got more energy than it gave; damping was added.</summary>
        HapticDamped = 16,
        /// <summary>A number was not finite, a quaternion not of length 1, or time ran backwards: no force.</summary>
        HapticBadInput = 32,
        /// <summary>Nothing supports the body: the model is that of one step from rest, not of rest.</summary>
        HapticWithInertia = 64,
        /// <summary>The tangent was indefinite; the model is that of the projected one.</summary>
        HapticProjected = 128,
        /// <summary>The model was not found in this step; that of an earlier one counts, or none.</summary>
        HapticUnsolved = 256,
        /// <summary>The step itself did not converge.</summary>
        HapticUnconverged = 512,
    }

    /// <summary>How a simulation is carried out. All 0 but `struct_size` and `dt` is fine; then there is no
    /// gravity.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeOptions
    {
        internal uint StructSize;
        internal uint Precision;
        internal uint Threads;
        internal uint Backend;
        internal double Dt;
        internal Vec3 Gravity;
    }

    /// <summary>A file that a scene names.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeFile
    {
        internal IntPtr Name;
        internal IntPtr Bytes;
        internal UIntPtr Size;
    }

    /// <summary>A group of vertices.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeGroup
    {
        internal IntPtr Name;
        internal IntPtr Vertices;
        internal UIntPtr VertexCount;
    }

    /// <summary>A mesh as arrays, in the order of vertices of Gmsh and VTK; what is not there is NULL and 0.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeMeshArrays
    {
        internal uint StructSize;
        internal uint Reserved;
        internal IntPtr Points;
        internal UIntPtr PointCount;
        internal IntPtr Tetrahedra;
        internal UIntPtr TetrahedronCount;
        internal IntPtr Hexahedra;
        internal UIntPtr HexahedronCount;
        internal IntPtr Triangles;
        internal UIntPtr TriangleCount;
        internal IntPtr Quads;
        internal UIntPtr QuadCount;
        internal IntPtr Groups;
        internal UIntPtr GroupCount;
    }

    /// <summary>A material: a preset, values, or both; a value that is not 0 takes the place of the preset's.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeMaterial
    {
        internal uint StructSize;
        internal uint Reserved;
        internal IntPtr Preset;
        internal double YoungModulus;
        internal double PoissonRatio;
        internal double Density;
        internal IntPtr YoungModuli;
        internal IntPtr PoissonRatios;
        internal IntPtr Densities;
        internal UIntPtr ElementCount;
    }

    /// <summary>A membrane on or instead of a solid.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeMembrane
    {
        internal uint StructSize;
        internal uint Surface;
        internal IntPtr Group;
        internal double Thickness;
        internal IntPtr Material;
        internal IntPtr Model;
        internal IntPtr Plane;
    }

    /// <summary>What activation does to fibres.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeMuscle
    {
        internal uint StructSize;
        internal uint Reserved;
        internal double PeakStress;
        internal double OptimalStretch;
        internal double Width;
        internal double Stiffening;
        internal double Shortening;
    }

    /// <summary>A family of fibres.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeFibre
    {
        internal uint StructSize;
        internal uint Reserved;
        internal IntPtr Name;
        internal IntPtr Directions;
        internal UIntPtr DirectionCount;
        internal double Modulus;
        internal double Viscosity;
        internal IntPtr Muscle;
        internal IntPtr Form;
    }

    /// <summary>What a body is made of. Names are those of scene files; NULL is the default.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeBody
    {
        internal uint StructSize;
        internal uint Reserved;
        internal IntPtr Name;
        internal IntPtr Material;
        internal IntPtr Model;
        internal IntPtr Evaluation;
        internal IntPtr Springs;
        internal double SpringConstant;
        internal IntPtr Masses;
        internal IntPtr Membrane;
        internal IntPtr Fibres;
        internal UIntPtr FibreCount;
        internal double VolumeModulus;
        internal IntPtr Volume;
        internal UIntPtr Spare;
        internal double Glue;
    }

    /// <summary>What a cut did.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct CutReport
    {
        internal uint StructSize;
        internal uint Reserved;
        /// <summary>Tetrahedra that it parted.</summary>
        public UIntPtr Separated;
        /// <summary>Copies of tetrahedra that it made.</summary>
        public UIntPtr Copies;
        /// <summary>Vertices that it made.</summary>
        public UIntPtr Vertices;
        /// <summary>Vertices that further cuts may make.</summary>
        public UIntPtr Spare;
        /// <summary>Connected pieces of the body now.</summary>
        public UIntPtr Pieces;
        /// <summary>Least share of a tetrahedron of the body now.</summary>
        public double LeastShare;
        /// <summary>Area (m^2, at rest) of one side of the wound.</summary>
        public double Area;
    }

    /// <summary>A constraint.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeConstraint
    {
        internal uint StructSize;
        internal uint Motion;
        internal IntPtr Name;
        internal IntPtr Vertices;
        internal UIntPtr VertexCount;
        internal uint Axes;
        internal uint Reserved;
        internal Vec3 Translation;
        internal Vec3 Centre;
        internal Vec3 Axis;
        internal double Angle;
        internal IntPtr Curve;
        internal UIntPtr CurveCount;
        internal double From;
        internal double Until;
    }

    /// <summary>A rigid part of a tool. Quaternions are x, y, z, w; all 0 is no rotation.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativePart
    {
        internal uint StructSize;
        internal uint Shape;
        internal IntPtr Mesh;
        internal double Spacing;
        internal double Radius;
        internal double HalfLength;
        internal Vec3 Half;
        internal double Rounding;
        internal Vec3 At;
        internal double Qx, Qy, Qz, Qw;
        internal double Jaw;
    }

    /// <summary>A rigid tool.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeTool
    {
        internal uint StructSize;
        internal uint Flags;
        internal IntPtr Name;
        internal IntPtr Parts;
        internal UIntPtr PartCount;
        internal Vec3 HingePoint;
        internal Vec3 HingeAxis;
        internal Vec3 Position;
        internal double Qx, Qy, Qz, Qw;
        internal double Opening;
        internal double Friction;
        internal double Stiffness;
        internal uint Points;
        internal uint Reserved;
        internal ulong OnBody;
        internal IntPtr OnTriangles;
        internal UIntPtr OnTriangleCount;
        internal IntPtr Edge;
        internal IntPtr Needle;
    }

    /// <summary>What a thread or clip goes through.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct ThreadPoint
    {
        /// <summary>A body of solid elements, whose tissue at the place is meant; a tool, for the channel that its
        /// needle went through; 0 for a place in space, such as a hand.</summary>
        public ulong Of;
        /// <summary>The place (m), in the present shape.</summary>
        public Vec3 At;
    }

    /// <summary>A spring and a damper from vertices to a moving pose.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativePull
    {
        internal uint StructSize;
        internal uint Reserved;
        internal IntPtr Name;
        internal IntPtr Vertices;
        internal UIntPtr VertexCount;
        internal IntPtr Weights;
        internal double Stiffness;
        internal double Damping;
    }

    /// <summary>What a ray met.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct Pick
    {
        internal uint StructSize;
        internal uint HitFlag;
        /// <summary>Body.</summary>
        public ulong Body;
        /// <summary>Vertices of the triangle.</summary>
        public uint Vertex0, Vertex1, Vertex2;
        internal uint Reserved;
        /// <summary>Barycentric coordinates of the point in it, for the weights of a pull.</summary>
        public Vec3 Weights;
        /// <summary>The point (m).</summary>
        public Vec3 Position;
        /// <summary>Its distance (m) from the origin of the ray.</summary>
        public double Distance;
    }

    /// <summary>Which elements to remove.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeRegion
    {
        internal uint StructSize;
        internal uint Kind;
        internal uint Element;
        internal uint KeepMass;
        internal IntPtr List;
        internal UIntPtr ListCount;
        internal Vec3 From;
        internal Vec3 To;
        internal double Radius;
        internal double Above;
    }

    /// <summary>How a haptic device holds vertices; 0 is the default of a number.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeHapticOptions
    {
        internal uint StructSize;
        internal uint Turns;
        internal IntPtr Name;
        internal IntPtr Vertices;
        internal UIntPtr VertexCount;
        internal double Stiffness;
        internal double Damping;
        internal double Limit;
        internal double Stale;
        internal double Fade;
        internal double DeviceMass;
        internal double Tolerance;
        internal double TorqueLimit;
        internal double DeviceInertia;
    }

    /// <summary>What a haptic device is to render until the next exchange.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct HapticFeedback
    {
        internal uint StructSize;
        /// <summary>Sum of `SINEW_HAPTIC_WAITING` and so on.</summary>
        public uint Flags;
        /// <summary>Force (N) on the hand.</summary>
        public Vec3 Force;
        /// <summary>Time (s) since the model of the last step arrived.</summary>
        public double Age;
        /// <summary>Steps that had been taken when that model was made.</summary>
        public ulong Step;
        /// <summary>Simulated time (s) at the end of that step.</summary>
        public double Time;
        /// <summary>Energy (J) that the hand has given so far; below zero it has got some.</summary>
        public double Energy;
        /// <summary>Exchanges in which damping was added so far.</summary>
        public ulong Dampings;
        /// <summary>Torque (N m) on the hand about where the device is; 0 where it does not turn what it
        /// holds.</summary>
        public Vec3 Torque;
    }

    /// <summary>Forces on a tool and its contacts at the end of the last step.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct ToolReport
    {
        internal uint StructSize;
        /// <summary>Number of its parts, if there are several.</summary>
        public uint Parts;
        /// <summary>Where the tool was: place (m) of its origin.</summary>
        public Vec3 Position;
        /// <summary>Way (m) from where the hand would have it to there, of a tool on a spring.</summary>
        public Vec3 Yields;
        /// <summary>Its rotation.</summary>
        public double Qx, Qy, Qz, Qw;
        /// <summary>Its opening (rad).</summary>
        public double Opening;
        /// <summary>Velocity (m/s) of its origin.</summary>
        public Vec3 Velocity;
        /// <summary>Angular velocity (rad/s).</summary>
        public Vec3 AngularVelocity;
        /// <summary>Force (N) on the tool: normal, friction, of what it cuts, and of the thread that its needle
        /// draws.</summary>
        public Vec3 Force;
        /// <summary>Torque (N m) on the tool about its origin.</summary>
        public Vec3 Torque;
        /// <summary>Torque (N m) about the hinge with which tissue holds its jaws open: the energy per angle (rad) that
        /// closing them takes.</summary>
        public double Closing;
        /// <summary>The part of the force that pressure makes (N).</summary>
        public Vec3 Normal;
        /// <summary>The part of the force that friction makes (N).</summary>
        public Vec3 Friction;
        /// <summary>Work (J) done by the tool on bodies since it came, by the force at the end of every step. That on
        /// the thread of its needle is in the report of the thread.</summary>
        public double Work;
        /// <summary>Energy (J) that friction has taken since it came.</summary>
        public double Dissipation;
        /// <summary>Energy (J) stored in its contacts: penetration and sticking.</summary>
        public double Energy;
        /// <summary>Area (m^2, at rest) that touches it.</summary>
        public double Area;
        /// <summary>Largest penetration (m).</summary>
        public double Depth;
        /// <summary>Largest pressure (Pa).</summary>
        public double Pressure;
        /// <summary>Centre of pressure (m); its origin while nothing touches it.</summary>
        public Vec3 Centre;
        /// <summary>Points that touch it and stick.</summary>
        public uint Sticking;
        /// <summary>Points that touch it and slip.</summary>
        public uint Slipping;
        /// <summary>Distance (m) to its target, where its way was longer than the substeps of a step can
        /// follow.</summary>
        public double Lag;
        /// <summary>How far (m) the surfaces of its shapes are drawn in, because it appeared partly inside of a body;
        /// of a cavity how far they are widened, because it appeared with tissue outside. A tool wholly inside touches
        /// nothing, and is counted as buried.</summary>
        public double DrawnIn;
        /// <summary>A part of it went through the surface of a body, and touches nothing of that body until it is
        /// out.</summary>
        public uint Pierced;
        /// <summary>Force (N) by points of the other kind at the same state, if `SINEW_ERROR_BAR` asks for it. It is no
        /// estimate of the error: these points have not pushed the tissue away, so it may be several times what they
        /// give in a run of their own. All 0 without.</summary>
        public Vec3 OtherPoints;
        /// <summary>Change of its force (N) per motion (m) of its pose at the end of the step, with the tissue moving
        /// along within the step, if `SINEW_LOCAL_STIFFNESS` asks for it of an implicit integrator: the force is about
        /// `force + local_stiffness * way`. Symmetric; limits of friction as they are. Exact for `newton`, to the
        /// tolerance of the linear solver. All 0 without.</summary>
        public Vec3 LocalStiffnessX, LocalStiffnessY, LocalStiffnessZ;
        /// <summary>Whether the step that these forces are of did not converge: they are not to be relied on.</summary>
        public uint Unconverged;
        /// <summary>Area (m^2, in the shapes of the steps) that its edge swept through tissue against its toughness
        /// since it came.</summary>
        public double CutArea;
        /// <summary>Energy (J) that this took, or the tip of its needle.</summary>
        public double Fracture;
        /// <summary>Elements that its edge parted since it came.</summary>
        public uint Separated;
        /// <summary>Vertices that this made.</summary>
        public uint CutVertices;
        /// <summary>Length (m) of its needle in tissue.</summary>
        public double Inserted;
        /// <summary>Force (N) of the tissue on the tip of its needle, against the direction of the tip.</summary>
        public double TipForce;
        /// <summary>Force (N) of the channel along the shaft, positive where it holds the needle back from going
        /// in.</summary>
        public double ShaftForce;
        /// <summary>Surfaces that gave way to its needle since it came.</summary>
        public uint Punctures;
    }

    /// <summary>Forces on one part of a tool, such as one of two jaws.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public partial struct PartReport
    {
        /// <summary>Force (N) on it, normal and friction.</summary>
        public Vec3 Force;
        /// <summary>Torque (N m) on it about the tool's origin.</summary>
        public Vec3 Torque;
        /// <summary>Largest penetration (m).</summary>
        public double Depth;
        /// <summary>Points that touch it and stick.</summary>
        public uint Sticking;
        /// <summary>Points that touch it and slip.</summary>
        public uint Slipping;
    }

    internal static partial class Native
    {
        internal const uint SINEW_ABI = 8;
        internal const uint SINEW_F64 = 0;
        internal const uint SINEW_F32 = 1;
        internal const uint SINEW_CPU = 0;
        internal const uint SINEW_GPU = 1;
        internal const uint SINEW_SKIN_POINTS = 0;
        internal const uint SINEW_SKIN_REST = 1;
        internal const uint SINEW_SKIN_DEPTH = 2;
        internal const uint SINEW_HOLD = 0;
        internal const uint SINEW_TRANSLATE = 1;
        internal const uint SINEW_ROTATE = 2;
        internal const uint SINEW_SPHERE = 0;
        internal const uint SINEW_CAPSULE = 1;
        internal const uint SINEW_BOX = 2;
        internal const uint SINEW_HALF_SPACE = 3;
        internal const uint SINEW_CLOSED_MESH = 4;
        internal const uint SINEW_LIST = 0;
        internal const uint SINEW_BALL = 1;
        internal const uint SINEW_SWEPT_BALL = 2;
        internal const uint SINEW_STRAIN_ABOVE = 3;
        internal const uint SINEW_STRESS_ABOVE = 4;
        internal const uint SINEW_TETRAHEDRA = 0;
        internal const uint SINEW_HEXAHEDRA = 1;
        internal const uint SINEW_TRIANGLES = 2;
        internal const uint SINEW_QUADS = 3;
        internal const uint SINEW_LIVE_POSITIONS = 0;
        internal const uint SINEW_LIVE_NORMALS = 1;
        internal const uint SINEW_LIVE_WRENCH = 2;

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_hold(SimulationHandle simulation, ulong body, byte[] name, uint[] vertices,
            UIntPtr vertexCount, out ulong result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_constraint_add(SimulationHandle simulation, ulong body,
            ref NativeConstraint constraint, out ulong result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_constraint_pose(SimulationHandle simulation, ulong constraint,
            ref Vec3 position, double[] quaternion, double[] centre);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_reaction(SimulationHandle simulation, ulong constraint, ref Vec3 about,
            out Vec3 force, out Vec3 torque);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_load_add(SimulationHandle simulation, ulong body, byte[] name, uint[] vertices,
            UIntPtr vertexCount, double[] forces, UIntPtr forceCount, out ulong result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_pressure_add(SimulationHandle simulation, ulong body, byte[] name,
            uint[] triangles, UIntPtr triangleCount, double pressure, out ulong result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_traction_add(SimulationHandle simulation, ulong body, byte[] name,
            uint[] faces, UIntPtr faceCount, uint corners, double[] traction, out ulong result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_body_add(SimulationHandle simulation, MeshHandle mesh, ref NativeBody body,
            out ulong result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_vertex_count(SimulationHandle simulation, ulong body, out UIntPtr count);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_group_vertices(SimulationHandle simulation, ulong body, byte[] group,
            uint[] result, UIntPtr capacity, out UIntPtr needed);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_read(SimulationHandle simulation, ulong body, uint quantity, double[] result,
            UIntPtr capacity, out UIntPtr needed);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_positions_f32(SimulationHandle simulation, ulong body, IntPtr xyz,
            UIntPtr vertices, UIntPtr strideBytes);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_set_state(SimulationHandle simulation, ulong body, double[] displacements,
            double[] velocities, UIntPtr vertices);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_surface(SimulationHandle simulation, ulong body, uint[] triangles,
            UIntPtr capacity, out UIntPtr needed, out ulong revision);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_set_material(SimulationHandle simulation, ulong body,
            ref NativeMaterial material);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_set_activation(SimulationHandle simulation, ulong body, byte[] family,
            double activation);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_remove_elements(SimulationHandle simulation, ulong body,
            ref NativeRegion region, out UIntPtr removed);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_cut(SimulationHandle simulation, ulong body, double[] strip,
            UIntPtr positionCount, ref CutReport report);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_skin_read(SimulationHandle simulation, ulong body, uint quantity,
            double[] result, UIntPtr capacity, out UIntPtr needed);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_skin_triangles(SimulationHandle simulation, ulong body, uint[] triangles,
            UIntPtr capacity, out UIntPtr needed, out ulong revision);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_skin_wound(SimulationHandle simulation, ulong body, uint[] result,
            UIntPtr capacity, out UIntPtr needed);

        [DllImport(Library, CallingConvention = C)]
        internal static extern IntPtr sinew_last_error();

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_haptic_add(SimulationHandle simulation, ulong body,
            ref NativeHapticOptions options, out ulong result, out IntPtr device);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_haptic_release(SimulationHandle simulation, ulong held);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_haptic_exchange(HapticDevice device, ref Vec3 position, ref Vec3 velocity,
            double seconds, ref HapticFeedback feedback);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_haptic_exchange_pose(HapticDevice device, ref Vec3 position,
            double[] quaternion, ref Vec3 velocity, ref Vec3 angularVelocity, double seconds, ref HapticFeedback feedback);

        [DllImport(Library, CallingConvention = C)]
        internal static extern void sinew_haptic_free(IntPtr device);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_live_share(SimulationHandle simulation, ulong[] bodies, UIntPtr bodyCount,
            ulong[] tools, UIntPtr toolCount, out IntPtr result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_live_update(LiveReader live, out uint isNew, out ulong step,
            out double seconds);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_live_read(LiveReader live, ulong handle, uint quantity, double seconds,
            double[] data, UIntPtr capacity, out UIntPtr needed);

        [DllImport(Library, CallingConvention = C)]
        internal static extern void sinew_live_free(IntPtr live);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_mesh_from_file(byte[] path, out IntPtr result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_mesh_from_bytes(byte[] name, byte[] bytes, UIntPtr size, out IntPtr result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_mesh_from_arrays(ref NativeMeshArrays arrays, out IntPtr result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_mesh_info_json(MeshHandle mesh, byte[] result, UIntPtr capacity,
            out UIntPtr needed);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_mesh_points(MeshHandle mesh, double[] xyz, UIntPtr capacity,
            out UIntPtr needed);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_mesh_cells(MeshHandle mesh, uint kind, uint[] vertices, UIntPtr capacity,
            out UIntPtr needed);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_mesh_group(MeshHandle mesh, byte[] name, uint[] vertices, UIntPtr capacity,
            out UIntPtr needed);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_mesh_cell_data(MeshHandle mesh, byte[] name, double[] values, UIntPtr capacity,
            out UIntPtr needed);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_mesh_select(MeshHandle mesh, byte[] selection, uint[] vertices,
            UIntPtr capacity, out UIntPtr needed);

        [DllImport(Library, CallingConvention = C)]
        internal static extern void sinew_mesh_free(IntPtr mesh);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_report_json(SimulationHandle simulation, byte[] result, UIntPtr capacity,
            out UIntPtr needed);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_warnings_json(SimulationHandle simulation, byte[] result, UIntPtr capacity,
            out UIntPtr needed);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_verdict(SimulationHandle simulation, byte[] result, UIntPtr capacity,
            out UIntPtr needed);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_energy(SimulationHandle simulation, out double elastic, out double kinetic);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_hash(SimulationHandle simulation, out ulong hash);

        [DllImport(Library, CallingConvention = C)]
        internal static extern uint sinew_abi_version();

        [DllImport(Library, CallingConvention = C)]
        internal static extern IntPtr sinew_version();

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_simulation_new(ref NativeOptions options, out IntPtr result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_simulation_from_scene(byte[] path, uint threads, out IntPtr result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_simulation_from_text(byte[] toml, byte[] name, NativeFile[] files,
            UIntPtr fileCount, uint threads, out IntPtr result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern void sinew_simulation_free(IntPtr simulation);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_step(SimulationHandle simulation, uint n);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_time(SimulationHandle simulation, out double seconds);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_set_dt(SimulationHandle simulation, double dt);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_set_gravity(SimulationHandle simulation, ref Vec3 gravity);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_set_solver(SimulationHandle simulation, byte[] settings);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_find(SimulationHandle simulation, uint kind, byte[] name, out ulong handle);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_remove(SimulationHandle simulation, ulong handle);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_snapshot_take(SimulationHandle simulation, out IntPtr result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_snapshot_restore(SimulationHandle simulation, SnapshotHandle snapshot);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_snapshot_to_bytes(SnapshotHandle snapshot, byte[] data, UIntPtr capacity,
            out UIntPtr needed);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_snapshot_from_bytes(byte[] bytes, UIntPtr size, out IntPtr result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern void sinew_snapshot_free(IntPtr snapshot);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_thread_add(SimulationHandle simulation, uint kind, byte[] lines,
            ThreadPoint[] points, UIntPtr pointCount, out ulong result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_thread_move(SimulationHandle simulation, ulong thread, uint point,
            ref Vec3 position);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_thread_draw(SimulationHandle simulation, ulong thread, uint end,
            double length);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_thread_hold(SimulationHandle simulation, ulong thread, uint end);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_thread_tie(SimulationHandle simulation, ulong thread);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_thread_cut(SimulationHandle simulation, ulong thread, uint segment,
            out ulong first, out ulong second);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_tear_set(SimulationHandle simulation, ulong body, byte[] lines);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_tool_add(SimulationHandle simulation, ref NativeTool tool, out ulong result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_tool_move(SimulationHandle simulation, ulong tool, ref Vec3 position,
            double[] quaternion, double opening, uint atOnce);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_tool_grip(SimulationHandle simulation, ulong tool, uint grip);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_read_tool_report(SimulationHandle simulation, ulong tool,
            ref ToolReport report);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_tool_parts(SimulationHandle simulation, ulong tool, PartReport[] result,
            UIntPtr capacity, out UIntPtr needed);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_contact_add(SimulationHandle simulation, byte[] name, ulong first,
            ulong second, double friction, out ulong result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_contact_force(SimulationHandle simulation, ulong contact, out Vec3 force,
            out double depth);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_pull_add(SimulationHandle simulation, ulong body, ref NativePull pull,
            out ulong result);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_pull_move(SimulationHandle simulation, ulong pull, ref Vec3 position,
            double[] quaternion, double[] centre);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_pull_force(SimulationHandle simulation, ulong pull, out Vec3 force,
            out double distance);

        [DllImport(Library, CallingConvention = C)]
        internal static extern int sinew_pick(SimulationHandle simulation, ref Vec3 origin, ref Vec3 direction,
            ref Pick result);
    }
}
