// The types of Unity that SinewBody.cs uses, so that it can be compiled without Unity. No part of a game.
using System;

namespace UnityEngine
{
    public struct Vector3
    {
        public float x, y, z;
        public Vector3(float x, float y, float z) { this.x = x; this.y = y; this.z = z; }
    }
    public class Object { public string name; }
    public class Component : Object { public T GetComponent<T>() where T : class { return null; } }
    public class Behaviour : Component { public bool enabled; }
    public class MonoBehaviour : Behaviour { }
    public class MeshFilter : Component { public Mesh sharedMesh { get; set; } }
    public class MeshRenderer : Component { }
    [AttributeUsage(AttributeTargets.Class)]
    public sealed class RequireComponent : Attribute { public RequireComponent(Type a, Type b) { } }
    public sealed class TooltipAttribute : Attribute { public TooltipAttribute(string text) { } }
    public static class Time { public static float fixedDeltaTime { get { return 0.02f; } } }
    public static class Debug { public static void LogError(object text, Object context) { } }
    public sealed class Mesh : Object
    {
        public Rendering.IndexFormat indexFormat { get; set; }
        public void MarkDynamic() { }
        public void SetVertexBufferParams(int count, params Rendering.VertexAttributeDescriptor[] attributes) { }
        public void SetVertexBufferData<T>(Unity.Collections.NativeArray<T> data, int dataStart, int meshBufferStart, int count,
            int stream, Rendering.MeshUpdateFlags flags) where T : struct { }
        public void SetTriangles(int[] triangles, int submesh) { }
        public void RecalculateNormals() { }
        public void RecalculateBounds() { }
    }
}

namespace UnityEngine.Rendering
{
    public enum IndexFormat { UInt16, UInt32 }
    [Flags] public enum MeshUpdateFlags { Default = 0, DontValidateIndices = 1 }
    public enum VertexAttribute { Position, Normal }
    public enum VertexAttributeFormat { Float32 }
    public struct VertexAttributeDescriptor
    {
        public VertexAttributeDescriptor(VertexAttribute attribute, VertexAttributeFormat format, int dimension, int stream) { }
    }
}

namespace Unity.Collections
{
    public enum Allocator { Persistent }
    public struct NativeArray<T> : IDisposable where T : struct
    {
        public NativeArray(int length, Allocator allocator) { Length = length; }
        public readonly int Length;
        public bool IsCreated { get { return Length > 0; } }
        public void Dispose() { }
    }
}

namespace Unity.Collections.LowLevel.Unsafe
{
    public static unsafe class NativeArrayUnsafeUtility
    {
        public static void* GetUnsafePtr<T>(NativeArray<T> array) where T : struct { return null; }
    }
}
